"""One JSON object per evaluation: inputs, versions, machine, metrics."""

from __future__ import annotations

import json
import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from autowaze.world.errors import AutowazeError

_PACKAGES = ("autowaze", "numpy", "numba", "scipy", "opencv-python-headless", "onnxruntime", "shapely")


def report(inputs: dict[str, Any], results: dict[str, dict[str, float]]) -> dict[str, Any]:
    """The document that `--json` writes.

    Args:
        inputs: what the command was given.
        results: metrics by trace or method; a single one becomes `metrics`, several stand under `results` too.
    """
    document: dict[str, Any] = {
        "inputs": inputs,
        "versions": {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}},
        "machine": {"processor": _processor(), "cores": os.cpu_count(), "system": platform.platform()},
    }
    if len(results) == 1:
        return {**document, "metrics": next(iter(results.values()))}
    return {**document, "metrics": {}, "results": results}


def write_report(path: str | Path, document: dict[str, Any]) -> None:
    """Write it; raises `AutowazeError` when the file cannot be written."""
    try:
        Path(path).write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise AutowazeError(f"{path}: cannot be written: {error.strerror}") from error


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
