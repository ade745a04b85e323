"""`python -m benchmarks [NAME]`: run every benchmark, or one."""

from __future__ import annotations

import importlib
import pkgutil
import sys

import benchmarks

names = sys.argv[1:2] or [m.name for m in pkgutil.iter_modules(benchmarks.__path__) if not m.name.startswith("_")]
for name in names:
    importlib.import_module(f"benchmarks.{name}").run()
