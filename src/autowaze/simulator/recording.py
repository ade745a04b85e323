"""Writing a simulated drive to a folder: in parallel processes, and on from where it was cut short."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from autowaze.simulator.description import StreetDescription
from autowaze.simulator.drive import Drive
from autowaze.simulator.simulated_trace import SimulatedFrame, SimulatedTrace
from autowaze.simulator.surroundings import streets_geojson
from autowaze.simulator.truth import SEEN_RANGE_M, SEEN_VACANT, SEEN_VEHICLE, is_vehicle, vehicle_state
from autowaze.traces.recorded import (
    PARKING_MAP,
    STREETS,
    TRUTH_FOLDER,
    FrameEntry,
    image_path,
    write_bytes,
    write_image,
    write_index,
    write_poses,
)
from autowaze.world.errors import TraceError
from autowaze.world.labels import ClassLabel

DEPTH_SCALE = 256.0
"""Depth images hold metres times 256, 0 where there is none, as KITTI's do."""
_OBSERVABLE_FRAMES = 3
_CHUNK = 8

Progress = Callable[[int, int], None]
"""Called with frames done and frames in all."""


def record(
    description: StreetDescription,
    folder: str | Path,
    workers: int | None = None,
    depth: bool = True,
    progress: Progress = lambda done, total: None,
) -> int:
    """Render a drive into a folder and return the number of frames.

    A folder that holds part of the same drive is completed; frames that are there are kept.

    Args:
        workers: processes; None takes one per processor.
        depth: whether to write depth images into the ground truth.

    Raises:
        TraceError: the folder holds another drive or cannot be written.
        DependencyError: OpenGL is missing.
    """
    folder = Path(folder)
    _claim(folder, description)
    # a core per process: the rasteriser's own threads would only get in the way
    trace = SimulatedTrace(description, threads=0)
    missing = [i for i in range(len(trace)) if not _view_path(folder, i).is_file()]
    done = len(trace) - len(missing)
    progress(done, len(trace))
    workers = min(workers or os.cpu_count() or 1, max(1, len(missing) // _CHUNK))
    for finished in _render_all(trace, folder, missing, workers, depth):
        done += finished
        progress(done, len(trace))
    trace.close()
    _write_summary(trace, folder)
    return len(trace)


def _claim(folder: Path, description: StreetDescription) -> None:
    """Mark the folder as this drive's own."""
    path = folder / TRUTH_FOLDER / "description.json"
    text = description.model_dump_json(indent=1) + "\n"
    try:
        if path.is_file():
            if path.read_text(encoding="utf-8") != text:
                raise TraceError(f"{folder}: holds another drive ({path}); give an empty folder")
            return
        if folder.exists() and any(folder.iterdir()):
            raise TraceError(f"{folder}: is not empty and holds no simulated drive; give an empty folder")
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TraceError(f"{folder}: cannot be used: {error.strerror}") from error
    write_bytes(path, text.encode())


def _render_all(trace: SimulatedTrace, folder: Path, missing: list[int], workers: int, depth: bool) -> Iterator[int]:
    if workers <= 1:
        for index in missing:
            _write_frame(folder, trace.render(index), depth)
            yield 1
        return
    chunks = [missing[i : i + _CHUNK] for i in range(0, len(missing), _CHUNK)]
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _open_worker, (trace.description,)) as pool:
        tasks = [pool.submit(_render_chunk, folder, chunk, depth) for chunk in chunks]
        for task in as_completed(tasks):
            yield task.result()


_worker_trace: SimulatedTrace | None = None


def _open_worker(description: StreetDescription) -> None:
    global _worker_trace  # noqa: PLW0603 - a process of the pool keeps its renderer between chunks
    _worker_trace = SimulatedTrace(description, threads=0)


def _render_chunk(folder: Path, indices: list[int], depth: bool) -> int:
    assert _worker_trace is not None
    for index in indices:
        _write_frame(folder, _worker_trace.render(index), depth)
    return len(indices)


def _view_path(folder: Path, index: int) -> Path:
    return folder / TRUTH_FOLDER / "views" / f"{index:06d}.json"


def _write_frame(folder: Path, frame: SimulatedFrame, depth: bool) -> None:
    index, truth = frame.stereo.index, folder / TRUTH_FOLDER
    write_image(image_path(folder, "left", index), frame.stereo.left)
    write_image(image_path(folder, "right", index), frame.stereo.right)
    write_image(image_path(truth, "ids", index), frame.ids.astype(np.uint16))
    if depth:
        metres = np.where(np.isfinite(frame.depth), frame.depth, 0.0)
        write_image(image_path(truth, "depth", index), np.minimum(metres * DEPTH_SCALE + 0.5, 65535).astype(np.uint16))
    ids, counts = np.unique(frame.ids, return_counts=True)
    view = {
        "spots": {v.spot_id: {"visible": v.visible, "range_m": v.range_m, "seen": v.seen} for v in frame.spots},
        "pixels": {str(i): int(n) for i, n in zip(ids, counts, strict=True) if i > 0},
    }
    # last, because it says that the frame is complete
    write_bytes(_view_path(folder, index), _json(view))


def _json(document: object) -> bytes:
    return (json.dumps(document, indent=1) + "\n").encode()


def _write_summary(trace: SimulatedTrace, folder: Path) -> None:
    drive, truth = trace.drive, folder / TRUTH_FOLDER
    write_poses(folder, trace.ground_truth.T_world_cam)
    write_bytes(folder / PARKING_MAP, _json(drive.street.plan.parking_geojson()))
    write_bytes(folder / STREETS, _json(streets_geojson(drive.street)))
    views = [json.loads(_view_path(folder, i).read_text(encoding="utf-8")) for i in range(len(trace))]
    write_bytes(truth / "truth.json", _json(_spot_truth(drive, views)))
    write_bytes(truth / "vehicles.json", _json(_still_vehicles(drive)))
    write_bytes(truth / "moving.json", _json(_moving_things(drive)))
    fixes = drive.fixes or (None,) * len(trace)
    entries = [FrameEntry(i, float(t), fix) for i, (t, fix) in enumerate(zip(drive.ego.timestamps, fixes, strict=True))]
    write_index(folder, trace.camera, entries)


def _spot_truth(drive: Drive, views: list[dict[str, Any]]) -> dict[str, Any]:
    """State of every spot over time, and which frames see it."""
    out: dict[str, Any] = {}
    for spot_id, occupant in drive.occupants().items():
        looks = [(i, view["spots"][spot_id]) for i, view in enumerate(views) if spot_id in view["spots"]]
        seen = [i for i, look in looks if look["seen"]]
        changes = [0, *(int(c) + 1 for c in np.flatnonzero(np.diff(occupant))), len(occupant)]
        out[spot_id] = {
            "occupied": bool(occupant[-1] > 0),
            "vehicle_id": int(occupant[-1]) or None,
            "history": [
                {"from_frame": a, "to_frame": b - 1, "vehicle_id": int(occupant[a]) or None}
                for a, b in pairwise(changes)
            ],
            "observable": len(seen) >= _OBSERVABLE_FRAMES,
            "seen_in_frames": seen,
            "best_visible_fraction": max((look["visible"] for _, look in looks), default=0.0),
            "nearest_range_when_seen_m": min((look["range_m"] for _, look in looks if look["seen"]), default=None),
        }
    return {
        "rule": f"seen: centre within {SEEN_RANGE_M:g} m and {SEEN_VACANT:g} of the vacant spot (ground to 0.8 m) or "
        f"{SEEN_VEHICLE:g} of the vehicle on it in view of the left camera; "
        f"observable: seen in {_OBSERVABLE_FRAMES} frames",
        "frames": len(views),
        "spots": out,
    }


def _still_vehicles(drive: Drive) -> dict[str, Any]:
    rows = []
    for thing in drive.still:
        if not is_vehicle(thing):
            continue
        box = vehicle_state(thing)
        rows.append(_box(box.id, thing.kind, thing.label) | {
            "center_xyz": [round(float(v), 4) for v in box.centre],
            "heading_rad": round(box.heading_rad, 5),
            **_size(thing.size),
        })  # fmt: skip
    return {
        "frame": "map: east, north, up, metres; centre of the box; heading counter-clockwise from east",
        "vehicles": rows,
    }


def _moving_things(drive: Drive) -> dict[str, Any]:
    rows = []
    for actor in drive.actors:
        thing = actor.thing
        shown = np.flatnonzero(np.isfinite(actor.poses[:, 0, 0]))
        track = [
            {
                "frame": int(i),
                "center_xyz": [round(float(v), 4) for v in actor.poses[i, :3, 3] + [0, 0, thing.size[2] / 2]],
                "heading_rad": round(float(np.arctan2(actor.poses[i, 1, 0], actor.poses[i, 0, 0])), 5),
            }
            for i in shown
        ]
        rows.append(_box(thing.id, thing.kind, thing.label) | _size(thing.size) | {"track": track})
    others = [
        _box(t.id, t.kind, t.label) | _size(t.size) | {"center_xyz": [round(float(v), 4) for v in t.T_map_thing[:3, 3]]}
        for t in drive.still
        if t.id > 0 and not is_vehicle(t)
    ]
    return {"frame": "as in vehicles.json", "moving": rows, "other_still_instances": others}


def _box(id: int, kind: str, label: ClassLabel) -> dict[str, Any]:
    return {"id": id, "kind": kind, "label": label.name, "class": int(label)}


def _size(size: tuple[float, float, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in zip(("length", "width", "height"), size, strict=True)}
