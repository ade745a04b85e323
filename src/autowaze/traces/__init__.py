"""Stereo drives coming in: one file per kind of source, one small protocol."""

from autowaze.traces.source import open_trace
from autowaze.traces.trace import GroundTruth, Trace

__all__ = ["GroundTruth", "Trace", "open_trace"]
