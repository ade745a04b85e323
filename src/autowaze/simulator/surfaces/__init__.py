"""Painted surfaces: masonry, asphalt, glass, leaves, car bodies."""
