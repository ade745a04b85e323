"""What a person may state about a model that its file does not say."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from autowaze.world.errors import ModelError

Layout = Literal[
    "cell-links", "yolo-seg", "torchvision-mask-rcnn", "detectron2-mask-rcnn", "onnx-zoo-mask-rcnn", "rf-detr-seg"
]


class ModelConfig(BaseModel):
    """Contents of the optional MODEL.json beside a model file.

    Attributes:
        layout: how to read the outputs; guessed from them when not given.
        class_names: class number to name; COCO's, in the layout's own numbering, when neither this nor the model's
            metadata says otherwise.
        min_confidence: detections below it are dropped.
        long_side: pixels of the longer side of the network's input where the export leaves it free.
        licence: shown to whoever loads the model.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    layout: Layout | None = None
    class_names: dict[int, str] | None = None
    min_confidence: float | None = Field(default=None, ge=0.0, le=1.0)
    long_side: int | None = Field(default=None, ge=64, le=8192)
    licence: str = ""

    @classmethod
    def beside(cls, model: Path) -> ModelConfig:
        """The configuration beside a model file; the defaults if there is none."""
        path = model.with_suffix(".json")
        if not path.is_file():
            return cls()
        try:
            return cls.model_validate_json(path.read_bytes())
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            raise ModelError(f"{path}: {where or 'not JSON'}: {first['msg']}") from error
