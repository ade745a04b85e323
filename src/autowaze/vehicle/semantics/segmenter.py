"""What every instance-segmentation model offers, and how one is opened."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from autowaze.vehicle.semantics.cell_links import CellLinks
from autowaze.vehicle.semantics.mask_rcnn import Detectron2MaskRcnn, OnnxZooMaskRcnn, TorchvisionMaskRcnn
from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.vehicle.semantics.model_store import BUNDLED, ModelStore, bundled_model
from autowaze.vehicle.semantics.network import Network, open_network
from autowaze.vehicle.semantics.rf_detr_seg import RfDetrSeg
from autowaze.vehicle.semantics.yolo_seg import YoloSeg
from autowaze.world.errors import ModelError
from autowaze.world.frame import Image
from autowaze.world.instances import Detections


class Segmenter(Protocol):
    """An instance-segmentation network (thesis, sec. 3.2.3)."""

    @property
    def name(self) -> str:
        """Short name for tables and logs."""

    def segment(self, image: Image) -> Detections:
        """Confident instances of one image, boxes and masks at its full size, most confident first."""


_LAYOUTS: dict[str, type[CellLinks] | type[YoloSeg] | type[RfDetrSeg] | type[TorchvisionMaskRcnn]] = {
    "cell-links": CellLinks,
    "yolo-seg": YoloSeg,
    "rf-detr-seg": RfDetrSeg,
    "detectron2-mask-rcnn": Detectron2MaskRcnn,
    "torchvision-mask-rcnn": TorchvisionMaskRcnn,
    "onnx-zoo-mask-rcnn": OnnxZooMaskRcnn,
}


def load_segmenter(
    model: str | Path, *, min_confidence: float | None = None, long_side: int | None = None, threads: int = 2
) -> Segmenter:
    """Open a model by file path, or by the name it has in the model store.

    Args:
        model: path of an .onnx or OpenVINO .xml file, or a name known to `model_store`; `bundled` is the one that
            comes with the package.
        min_confidence: detections below it are dropped; None for the model's own default.
        long_side: pixels of the longer side of the input of an export of free size; None for the model's default.
        threads: cores that the network may use.

    Raises:
        ModelError: no such file or name, not a readable model, or none of the known layouts.
        DependencyError: the model needs a package that is not installed.
    """
    path = Path(model)
    if path.name == str(model) and not path.suffix and not path.exists():
        path = bundled_model() if path.name == BUNDLED else ModelStore().path(path.name)
    network = open_network(path, threads)
    stated = {"min_confidence": min_confidence, "long_side": long_side}
    config = ModelConfig.beside(path).model_copy(update={k: v for k, v in stated.items() if v is not None})
    return _LAYOUTS[config.layout or _guess_layout(network)](network, config)


def _guess_layout(network: Network) -> str:
    for layout, adapter in _LAYOUTS.items():
        if adapter.recognises(network):
            return layout
    outputs = ", ".join(f"{name} {list(shape)}" for name, shape in network.outputs.items())
    raise ModelError(
        f"{network.path}: outputs {outputs} are of no known layout ({', '.join(_LAYOUTS)}); "
        f"state the layout in {network.path.stem}.json"
    )
