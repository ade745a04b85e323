"""Streets, cars, traffic and light; renders stereo drives with ground truth, headless, on a CPU."""

from autowaze.simulator.description import StreetDescription, load_description
from autowaze.simulator.presets import PRESETS
from autowaze.simulator.recording import record
from autowaze.simulator.simulated_trace import SimulatedFrame, SimulatedTrace

__all__ = ["PRESETS", "SimulatedFrame", "SimulatedTrace", "StreetDescription", "load_description", "record"]
