"""Autowaze turns a car with a stereo camera into a parking sensor."""

__version__ = "0.1.0"
