"""From a stereo pair to ORB features with depth: the thesis's camera features."""
