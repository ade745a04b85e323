"""The door: thin commands, no logic."""
