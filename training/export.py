"""From trained weights to the ONNX file that ships, and back."""

from __future__ import annotations

import copy
import warnings
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from training.network import SHOWN, STRIDE, Conv, Network

HALF = ".half"
"""Ends the names of weights that are stored as float16."""

_OPSET = 17
_QUANTISED = "_quantized"


def export(network: Network, path: Path) -> None:
    """Write the network with its normalisation folded in, weights as float16 (the arithmetic stays float32)."""
    folded = _folded(network)
    partial = path.with_suffix(".part")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            folded,
            (torch.zeros(1, 1, 2 * STRIDE, 2 * STRIDE),),
            str(partial),
            input_names=["image"],
            output_names=["cells"],
            dynamic_axes={"image": {2: "height", 3: "width"}, "cells": {2: "rows", 3: "columns"}},
            opset_version=_OPSET,
            dynamo=False,
        )
    model = onnx.load(str(partial))
    _halve_weights(model)
    onnx.checker.check_model(model)
    onnx.save(model, str(partial))
    partial.replace(path)


def _folded(network: Network) -> Network:
    """A copy for inference without normalisation layers and votes."""
    network = copy.deepcopy(network).cpu().to(memory_format=torch.contiguous_format).eval()
    for module in network.modules():
        if isinstance(module, Conv):
            module.conv = torch.nn.utils.fusion.fuse_conv_bn_eval(module.conv, module.norm)
            module.norm = torch.nn.Identity()  # type: ignore[assignment]
    shown = torch.nn.Conv2d(network.out.in_channels, 4 * SHOWN, 1)
    with torch.no_grad():
        shown.weight.copy_(network.out.weight[: 4 * SHOWN])
        shown.bias.copy_(network.out.bias[: 4 * SHOWN])  # type: ignore[union-attr,index]
    network.out = shown
    return network


def _halve_weights(model: onnx.ModelProto) -> None:
    """Store weights as float16 with a cast behind each, which onnxruntime folds when it loads the model."""
    casts = []
    for tensor in model.graph.initializer:
        if tensor.data_type != TensorProto.FLOAT or len(tensor.dims) != 4:
            continue
        half = numpy_helper.to_array(tensor).astype(np.float16)
        casts.append(helper.make_node("Cast", [f"{tensor.name}{HALF}"], [tensor.name], to=TensorProto.FLOAT))
        tensor.CopyFrom(numpy_helper.from_array(half, f"{tensor.name}{HALF}"))
    nodes = list(model.graph.node)
    del model.graph.node[:]
    model.graph.node.extend([*casts, *nodes])


@torch.no_grad()
def load_exported(network: Network, path: Path, images: torch.Tensor) -> None:
    """Give a network the weights of an exported model, so that training goes on from there.

    Normalisation was folded away: each layer's is set to what its convolution now puts out on `images`
    (N, 1, H, W), with scale and shift that leave the layer as it was. Votes are not exported; they begin anew.
    """
    weights = {name: torch.tensor(values) for name, values in _weights(onnx.load(str(path))).items()}
    hooks = []
    for name, module in network.named_modules():
        if isinstance(module, Conv):
            module.conv.weight.copy_(weights[f"{name}.conv.weight"])
            hooks.append(module.norm.register_forward_pre_hook(_measuring(weights[f"{name}.conv.bias"])))
    for name in ("out", "link"):
        head, rows = getattr(network, name), len(weights[f"{name}.bias"])
        head.weight[:rows] = weights[f"{name}.weight"]
        head.bias[:rows] = weights[f"{name}.bias"]
    network.eval()(images)
    network.train()
    for hook in hooks:
        hook.remove()


def _weights(model: onnx.ModelProto) -> dict[str, NDArray[np.float32]]:
    """Weights and biases by their names in the network; halved or quantised ones made float32 again."""
    stored = {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    weights = {}
    for name, values in stored.items():
        plain = name.removesuffix(HALF).removesuffix(_QUANTISED)
        weights[plain] = values.astype(np.float32)
        if name.endswith(_QUANTISED):
            scale = stored.get(f"{plain}_scale", stored.get(f"{name}_scale"))
            weights[plain] *= np.asarray(scale).reshape(-1, *[1] * (values.ndim - 1))
    return weights


def _measuring(bias: torch.Tensor):  # type: ignore[no-untyped-def]
    def measure(norm: torch.nn.BatchNorm2d, inputs: tuple[torch.Tensor, ...]) -> None:
        mean, variance = inputs[0].mean((0, 2, 3)), inputs[0].var((0, 2, 3))
        norm.running_mean.copy_(mean)  # type: ignore[union-attr]
        norm.running_var.copy_(variance)  # type: ignore[union-attr]
        norm.weight.copy_(torch.sqrt(variance + norm.eps))
        norm.bias.copy_(mean + bias)

    return measure
