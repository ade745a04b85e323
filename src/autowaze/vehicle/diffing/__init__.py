"""The semantic map diff: persistent, new and removed over a time window (thesis, sec. 3.2.6)."""

from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.vehicle.diffing.window import DiffWindow, FrameObservation

__all__ = ["DiffSettings", "DiffWindow", "FrameObservation"]
