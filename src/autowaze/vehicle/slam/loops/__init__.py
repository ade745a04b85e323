"""Coming back to where the drive was before: places recognised, the whole drive adjusted."""
