"""What every instance-segmentation model offers, and how one is opened."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from autowaze.world.frame import Image
from autowaze.world.instances import Detections


class Segmenter(Protocol):
    """An instance-segmentation network (thesis, sec. 3.2.3)."""

    @property
    def name(self) -> str:
        """Short name for tables and logs."""

    def segment(self, image: Image) -> Detections:
        """Confident instances of one image, boxes and masks at its full size, most confident first."""


def load_segmenter(model: str | Path, *, min_confidence: float | None = None, threads: int = 2) -> Segmenter:
    """Open a model by file path, or by the name it has in the model store.

    Args:
        model: path of an .onnx or OpenVINO .xml file, or a name known to `model_store`.
        min_confidence: detections below it are dropped; None for the layout's default.
        threads: cores that the network may use.

    Raises:
        ModelError: no such file or name, not a readable model, or none of the known layouts.
    """
    raise NotImplementedError
