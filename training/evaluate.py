"""How good a model is: simulated streets that training never saw, and real drives against a large model.

The scoring is `autowaze.evaluation.segmentation`'s. Instances that are smaller than the limit count neither way:
missing one is no fault, finding one no merit. What touches is judged among the instances above the limit.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autowaze.evaluation.segmentation import MIN_AREA, FrameScore, disjoint_masks, run_segmenter, summarise
from autowaze.simulator import SimulatedTrace, load_description
from autowaze.simulator.presets import PRESETS
from autowaze.traces import open_trace
from autowaze.vehicle.semantics.segmenter import Segmenter, load_segmenter
from autowaze.world.instances import Detections
from autowaze.world.labels import is_vehicle

_FIRST_SEED = 50_000
_REFERENCE_CONFIDENCE, _REFERENCE_LONG_SIDE = 0.5, 1248
_EVERY = 5
_WARM_UP, _TIMED = 3, 20


@dataclass(frozen=True)
class LabelledFrame:
    """An image with the vehicles in it: ids (H, W) uint16, 0 where there is none."""

    image: NDArray[np.uint8]
    ids: NDArray[np.uint16]

    @property
    def masks(self) -> NDArray[np.bool_]:
        """(T, H, W), in order of ids."""
        present = np.unique(self.ids)
        return (
            np.stack([self.ids == i for i in present if i]) if present.any() else np.zeros((0, *self.ids.shape), bool)
        )


def simulated_frames(cache: Path, streets: int, frames: int) -> Iterator[tuple[str, list[LabelledFrame]]]:
    """Frames spread over drives through streets of all presets with seeds of their own; rendered once, then kept."""
    presets = list(PRESETS)
    for number in range(streets):
        seed = _FIRST_SEED + number
        name = f"{presets[number % len(presets)]}-{seed}"
        path = cache / f"evaluation-{name}-{frames}.npz"
        if not path.is_file():
            cache.mkdir(parents=True, exist_ok=True)
            description = load_description(presets[number % len(presets)], seed=seed, rig={"name": "kitti"})
            _render(SimulatedTrace(description), frames, path)
        data = np.load(path)
        yield name, [LabelledFrame(image, ids) for image, ids in zip(data["images"], data["ids"], strict=True)]


def _render(trace: SimulatedTrace, frames: int, path: Path) -> None:
    images, ids = [], []
    for index in np.linspace(0, len(trace) - 1, frames).astype(int):
        frame = trace.render(int(index))
        vehicles = np.array([v.id for v in frame.vehicles])
        images.append(frame.stereo.left)
        ids.append(np.where(np.isin(frame.ids, vehicles), frame.ids, 0).astype(np.uint16))
    trace.close()
    np.savez_compressed(path, images=np.stack(images), ids=np.stack(ids))


def real_frames(drive: Path, reference: Path, cache: Path) -> list[LabelledFrame]:
    """Every fifth frame of a drive, with what the reference model finds for truth."""
    path = cache / f"reference-{drive.name}-{reference.stem}.npz"
    if not path.is_file():
        cache.mkdir(parents=True, exist_ok=True)
        model = load_segmenter(reference, min_confidence=_REFERENCE_CONFIDENCE, long_side=_REFERENCE_LONG_SIDE)
        frames = [frame.left for frame in open_trace(drive, "auto", slice(0, None, _EVERY))]
        np.savez_compressed(path, images=np.stack(frames), ids=np.stack([_as_ids(model.segment(f)) for f in frames]))
    data = np.load(path)
    return [LabelledFrame(image, ids) for image, ids in zip(data["images"], data["ids"], strict=True)]


def _as_ids(detections: Detections) -> NDArray[np.uint16]:
    """Vehicles, one id each; where they overlap the pixel is of the more confident one."""
    ids = np.zeros(detections.mask.shape[1:], np.uint16)
    for number, mask in enumerate(disjoint_masks(detections[is_vehicle(detections.label)]), start=1):
        ids[mask] = number
    return ids


def score(model: Segmenter, frames: list[LabelledFrame]) -> list[FrameScore]:
    """Scores of all vehicles, large or small."""
    return run_segmenter(model, ((frame.image, frame.masks) for frame in frames)).frames


def figures(scores: list[FrameScore]) -> dict[str, float]:
    """The figures that the bars are about."""
    summary = summarise(scores, MIN_AREA)
    return {"vehicles": summary.pop("instances"), **summary}


def milliseconds(model: Segmenter, image: NDArray[np.uint8]) -> dict[str, float]:
    """Median time of a frame, network and decoding, by the clock and in processor time of all threads."""
    wall, cpu = [], []
    for _ in range(_WARM_UP + _TIMED):
        start, start_cpu = time.perf_counter(), time.process_time()
        model.segment(image)
        wall.append(time.perf_counter() - start)
        cpu.append(time.process_time() - start_cpu)
    return {
        "segment_ms_median": 1000 * float(np.median(wall[_WARM_UP:])),
        "segment_ms_fastest": 1000 * min(wall[_WARM_UP:]),
        "segment_cpu_ms_median": 1000 * float(np.median(cpu[_WARM_UP:])),
    }


def evaluate(
    model: Segmenter, cache: Path, streets: int, frames: int, drives: list[Path], reference: Path | None
) -> dict[str, dict[str, float]]:
    """Figures by what they were measured on."""
    results: dict[str, dict[str, float]] = {}
    of_streets: list[FrameScore] = []
    image: NDArray[np.uint8] | None = None
    for name, labelled in simulated_frames(cache, streets, frames):
        scores = score(model, labelled)
        of_streets += scores
        results[name] = figures(scores)
        image = labelled[0].image
    if of_streets:
        results["all streets"] = figures(of_streets)
    for drive in drives if reference else []:
        assert reference is not None
        labelled = real_frames(drive, reference, cache)
        results[drive.name] = figures(score(model, labelled))
        image = labelled[0].image
    if image is not None:
        results["speed"] = milliseconds(model, image)
    return results
