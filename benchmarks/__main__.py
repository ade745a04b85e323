"""`python -m benchmarks [NAME]`: run every benchmark, or one."""

from __future__ import annotations

import importlib
import sys

BENCHMARKS = (
    "odometry",
    "tracking_profile",
    "known_map",
    "main_job",
    "boxes",
    "semantics",
    "cloud",
    "load",
    "crash",
    "mutated",
    "nearest",
    "edits",
    "simulator",
)

for name in sys.argv[1:2] or BENCHMARKS:
    importlib.import_module(f"benchmarks.{name}").run()
