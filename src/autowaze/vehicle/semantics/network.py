"""Running exported networks: onnxruntime, or OpenVINO where it is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import DependencyError, ModelError

Shape = tuple[int | None, ...]
"""Dimensions of a tensor; None where the export leaves one free."""


class Network(Protocol):
    """An exported network on the CPU.

    Attributes:
        path: the file, for errors.
        metadata: what the exporter wrote about the model.
        inputs, outputs: shapes by tensor name, in the order of the file.
    """

    path: Path
    metadata: dict[str, str]
    inputs: dict[str, Shape]
    outputs: dict[str, Shape]

    def run(self, tensors: dict[str, NDArray[Any]]) -> list[NDArray[Any]]:
        """Outputs in the order of the file."""


class OnnxNetwork:
    """An .onnx file in onnxruntime."""

    def __init__(self, path: Path, threads: int) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.use_deterministic_compute = True
        # Spinning threads would keep the cores from feature extraction, which runs at the same time.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's errors share no public base
            reason = str(error).strip().splitlines()[0]
            raise ModelError(f"{path}: onnxruntime cannot load it: {reason}; export the model again") from error
        self.path = path
        self.metadata = dict(self._session.get_modelmeta().custom_metadata_map)
        self.inputs = {t.name: _shape(t.shape) for t in self._session.get_inputs()}
        self.outputs = {t.name: _shape(t.shape) for t in self._session.get_outputs()}

    def run(self, tensors: dict[str, NDArray[Any]]) -> list[NDArray[Any]]:
        """Outputs in the order of the file."""
        try:
            return list(self._session.run(None, tensors))
        except Exception as error:
            reason = str(error).strip().splitlines()[0]
            raise ModelError(f"{self.path}: the network failed: {reason}") from error


class OpenVinoNetwork:
    """An OpenVINO .xml file with the .bin beside it."""

    def __init__(self, path: Path, threads: int) -> None:
        try:
            import openvino
        except ImportError as error:
            raise DependencyError(f"{path}: needs OpenVINO; pip install 'autowaze[openvino]'") from error
        if not path.with_suffix(".bin").is_file():
            raise ModelError(f"{path.with_suffix('.bin')}: missing; an OpenVINO model is an .xml and a .bin")
        self._core = openvino.Core()
        self._threads = threads
        try:
            self._model = self._core.read_model(path)
        except RuntimeError as error:
            raise ModelError(f"{path}: OpenVINO cannot read it: {str(error).splitlines()[0]}") from error
        self.path = path
        self.metadata = self._rt_info()
        self.inputs = {t.any_name: _shape(list(t.partial_shape)) for t in self._model.inputs}
        self.outputs = {
            (t.any_name if t.names else str(i)): _shape(list(t.partial_shape))
            for i, t in enumerate(self._model.outputs)
        }
        self._compiled: dict[tuple[tuple[int, ...], ...], Any] = {}

    def run(self, tensors: dict[str, NDArray[Any]]) -> list[NDArray[Any]]:
        """Outputs in the order of the file."""
        request = self._request(tensors)
        request.infer(tensors, share_inputs=True)
        return [np.array(tensor.data) for tensor in request.output_tensors]

    def _request(self, tensors: dict[str, NDArray[Any]]) -> Any:
        """An inference request compiled for the inputs' shapes: a fixed shape runs a tenth faster than a free one."""
        shapes = tuple(t.shape for t in tensors.values())
        if shapes not in self._compiled:
            self._model.reshape({name: list(t.shape) for name, t in tensors.items()})
            options = {
                "INFERENCE_NUM_THREADS": self._threads,
                # bf16, the default of some processors, rounds decoded box coordinates to steps of 8 px.
                "INFERENCE_PRECISION_HINT": "f32",
                "PERFORMANCE_HINT": "LATENCY",
            }
            self._compiled[shapes] = self._core.compile_model(self._model, "CPU", options).create_infer_request()
        return self._compiled[shapes]

    def _rt_info(self) -> dict[str, str]:
        if not self._model.has_rt_info(["model_info"]):
            return {}
        info = self._model.get_rt_info()["model_info"]
        return {key: str(getattr(value, "value", value)) for key, value in info.items()}


def open_network(path: Path, threads: int) -> Network:
    """The network in a file, by its suffix.

    Raises:
        ModelError: missing, of an unknown kind or damaged.
        DependencyError: OpenVINO is not installed.
    """
    if not path.is_file():
        raise ModelError(f"{path}: no such model file; give a path, or a name that `autowaze models list` shows")
    if path.suffix == ".onnx":
        return OnnxNetwork(path, threads)
    if path.suffix == ".xml":
        return OpenVinoNetwork(path, threads)
    raise ModelError(f"{path}: unknown kind of model; export it to .onnx, or to OpenVINO's .xml and .bin")


def _shape(dimensions: list[Any]) -> Shape:
    """Dimensions as numbers; names, None and OpenVINO's dynamic ones become None."""
    fixed = [d.get_length() if getattr(d, "is_static", False) else d for d in dimensions]
    return tuple(d if isinstance(d, int) else None for d in fixed)
