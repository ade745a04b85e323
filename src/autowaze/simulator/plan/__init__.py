"""The street seen from above: roads, bays, pavements, building lines."""
