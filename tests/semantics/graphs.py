"""Small ONNX graphs with the outputs of well-known exports: constants that pretend to be detections."""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper


def constant_network(
    path: Path, input_shape: list, outputs: dict[str, np.ndarray], metadata: dict[str, str] | None = None, free=()
) -> Path:
    """A network that ignores its image and returns the arrays; outputs in `free` declare no fixed shape."""
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, input_shape)
    nodes = [helper.make_node("ReduceMax", ["image"], ["peak"], keepdims=0)]
    declared, constants = [], [numpy_helper.from_array(np.array(0.0, np.float32), "zero")]
    nodes.append(helper.make_node("Mul", ["peak", "zero"], ["nothing"]))
    for name, array in outputs.items():
        constants.append(numpy_helper.from_array(array, f"{name}_value"))
        kind = helper.np_dtype_to_tensor_dtype(array.dtype)
        if array.dtype == np.float32:
            nodes.append(helper.make_node("Add", [f"{name}_value", "nothing"], [name]))
        else:
            nodes.append(helper.make_node("Identity", [f"{name}_value"], [name]))
        shape = [f"{name}_{i}" for i in range(array.ndim)] if name in free else list(array.shape)
        declared.append(helper.make_tensor_value_info(name, kind, shape))
    model = helper.make_model(
        helper.make_graph(nodes, "constant", [image], declared, constants),
        opset_imports=[helper.make_opsetid("", 17)],
        ir_version=9,
    )
    for key, value in (metadata or {}).items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.save(model, path)
    return path
