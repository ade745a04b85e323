"""Putting a trained model into the package."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from autowaze.vehicle.semantics.cell_links import CLASSES
from autowaze.vehicle.semantics.model_store import bundled_model

_MAX_BYTES = 6_000_000


def ship(model: Path) -> None:
    """Copy an exported model into the package and write the configuration beside it."""
    size = model.stat().st_size
    if size > _MAX_BYTES:
        raise SystemExit(f"{model}: {size} bytes; the package takes at most {_MAX_BYTES}")
    target = bundled_model()
    target.parent.mkdir(exist_ok=True)
    shutil.copyfile(model, target)
    config = {
        "layout": "cell-links",
        "class_names": dict(enumerate(CLASSES)),
        "licence": "Apache-2.0",
    }
    target.with_suffix(".json").write_text(json.dumps(config, indent=2) + "\n")
    print(f"{target}: {size} bytes")
