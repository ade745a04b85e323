"""Training: on a CPU a core takes some 25 crops a second; on a GPU the workers that make the crops are the limit."""

from __future__ import annotations

import copy
import math
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import distributed
from torch.utils.data import DataLoader

from training.export import export, load_exported
from training.loss import losses
from training.network import Network
from training.samples import Samples

_WEIGHT_DECAY = 0.03
_WARM_UP, _LAST_SHARE = 150, 0.02
_AVERAGE_EVERY = 8
_EMA = 0.98
"""Of the averages; about 400 steps count."""
_SAVE_EVERY = 50
_EASY = 0.5
"""Share of the steps in which the samples grow harder."""


@dataclass(frozen=True)
class Plan:
    """What to train with.

    Attributes:
        data: folder of `generate`; it may grow meanwhile.
        run: folder for checkpoint.pt, model.onnx (of the averaged weights) and log.txt.
        steps: batches in all, of each process.
        lr: highest learning rate.
        start_from: an exported model whose weights a new run begins with.
        hardness: of the samples, 0 to 1.
        processes: of one thread each. On small machines that is faster than as many threads in one process.
        device: "cpu", or "cuda" for one process on a GPU.
        workers: processes that make crops, for each process that trains.
        minutes: by the clock, over which the learning rate's cycle is spread in place of `steps`; None for steps.
    """

    data: Path
    run: Path
    steps: int
    batch: int = 8
    lr: float = 3e-3
    start_from: Path | None = None
    processes: int = 1
    hardness: float = 1.0
    seed: int = 0
    device: str = "cpu"
    workers: int = 1
    minutes: float | None = None


def train(plan: Plan) -> None:
    """Train; a run that was cut short goes on from its checkpoint.

    Every process takes steps of its own, and now and then their weights are averaged (local SGD, Stich 2019).
    """
    if plan.device != "cpu" and plan.processes > 1:
        raise SystemExit("on a GPU one process trains: give --processes 1, and --workers for the crops")
    plan.run.mkdir(parents=True, exist_ok=True)
    if plan.processes == 1:
        _work(0, plan, "")
        return
    with tempfile.TemporaryDirectory() as meeting:
        torch.multiprocessing.spawn(_work, (plan, f"file://{meeting}/ranks"), plan.processes)  # type: ignore[no-untyped-call]


def _work(rank: int, plan: Plan, meeting: str) -> None:
    torch.set_num_threads(1)
    torch.manual_seed(plan.seed)
    if plan.processes > 1:
        distributed.init_process_group("gloo", init_method=meeting, rank=rank, world_size=plan.processes)
    network = Network()
    checkpoint = plan.run / "checkpoint.pt"
    state = torch.load(checkpoint, weights_only=True, map_location=plan.device) if checkpoint.is_file() else None
    done = state["step"] if state else 0
    easy = 0 if plan.start_from else int(_EASY * plan.steps) * plan.batch
    samples = Samples(plan.data, 1000 * plan.seed + 100 * rank + done, done * plan.batch, easy, plan.hardness)
    loader = iter(DataLoader(samples, batch_size=plan.batch, num_workers=plan.workers, prefetch_factor=4))
    if plan.start_from is not None and state is None:
        load_exported(network, plan.start_from, torch.cat([next(loader)[0] for _ in range(4)]))
    network = network.to(plan.device, memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(_groups(network), lr=plan.lr, betas=(0.9, 0.99))
    averaged = copy.deepcopy(network)
    if state:
        network.load_state_dict(state["network"])
        averaged.load_state_dict(state["averaged"])
        optimizer.load_state_dict(state["optimizer"])
    spent = state["spent"] if state else 0.0
    start, sums = time.monotonic(), dict[str, float]()
    for step in range(done, plan.steps):
        for group in optimizer.param_groups:
            share = (spent + time.monotonic() - start) / (60 * plan.minutes) if plan.minutes else step / plan.steps
            group["lr"] = plan.lr * _schedule(step, share)
        for name, value in _step(network, optimizer, next(loader)).items():
            sums[name] = sums.get(name, 0.0) + value
        if (step + 1) % _AVERAGE_EVERY == 0:
            _agree(network, plan.processes)
            rounds = (step + 1) // _AVERAGE_EVERY
            _average(averaged, network, min(_EMA, (1 + rounds) / (10 + rounds)))
        last = share >= 1.0 or step + 1 == plan.steps
        if rank == 0 and ((step + 1) % _SAVE_EVERY == 0 or last):
            means = " ".join(f"{name} {value / _SAVE_EVERY:.3f}" for name, value in sums.items())
            line = f"step {step + 1} {time.monotonic() - start:.0f} s {means}"
            print(line, flush=True)
            with (plan.run / "log.txt").open("a") as log:
                log.write(line + "\n")
            sums = {}
            _save(checkpoint, network, averaged, optimizer, step + 1, spent + time.monotonic() - start)
            export(averaged, plan.run / "model.onnx")
        if last:
            break


@torch.no_grad()
def _agree(network: Network, processes: int) -> None:
    """Give all processes the mean of their weights."""
    if processes > 1:
        tensors = [t for t in network.state_dict().values() if t.dtype.is_floating_point]
        flat = torch.cat([t.flatten() for t in tensors])
        distributed.all_reduce(flat)
        for tensor, mean in zip(tensors, (flat / processes).split([t.numel() for t in tensors]), strict=True):
            tensor.copy_(mean.view_as(tensor))


def _groups(network: Network) -> list[dict[str, object]]:
    decayed = [p for p in network.parameters() if p.ndim > 1]
    plain = [p for p in network.parameters() if p.ndim <= 1]
    return [{"params": decayed, "weight_decay": _WEIGHT_DECAY}, {"params": plain, "weight_decay": 0.0}]


def _schedule(step: int, share: float) -> float:
    """Share of the highest learning rate: up in a line, down along a cosine."""
    warm = min(1.0, (step + 1) / _WARM_UP)
    return warm * (_LAST_SHARE + (1 - _LAST_SHARE) * 0.5 * (1 + math.cos(math.pi * min(share, 1.0))))


def _step(network: Network, optimizer: torch.optim.Optimizer, sample: tuple[torch.Tensor, ...]) -> dict[str, float]:
    device = next(network.parameters()).device
    image, classes, boxes, weight, owner, bond = (tensor.to(device) for tensor in sample)
    with torch.autocast(device.type, torch.bfloat16):
        output = network(image.contiguous(memory_format=torch.channels_last))
    terms = losses(output.float(), classes, boxes, weight, owner, bond)
    optimizer.zero_grad(set_to_none=True)
    sum(terms.values()).backward()  # type: ignore[union-attr]
    torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
    optimizer.step()
    return {name: float(value.detach()) for name, value in terms.items()}


@torch.no_grad()
def _average(averaged: Network, network: Network, decay: float) -> None:
    for mean, now in zip(averaged.state_dict().values(), network.state_dict().values(), strict=True):
        if mean.dtype.is_floating_point:
            mean.lerp_(now, 1 - decay)
        else:
            mean.copy_(now)


def _save(
    path: Path, network: Network, averaged: Network, optimizer: torch.optim.Optimizer, step: int, spent: float
) -> None:
    state = {
        "spent": spent,
        "network": network.state_dict(),
        "averaged": averaged.state_dict(),
        "optimizer": optimizer.state_dict(),
        "step": step,
    }
    partial = path.with_suffix(".part")
    torch.save(state, partial)
    partial.replace(path)
