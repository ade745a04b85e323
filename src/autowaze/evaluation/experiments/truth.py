"""What was true of a drive: spots, which of them it could see, and the vehicles; opened by evaluation only."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autowaze.evaluation.departure import ParkedVehicle
from autowaze.traces.recorded import TRUTH_FOLDER
from autowaze.world.errors import AutowazeError
from autowaze.world.pose import Pose, transform
from autowaze.world.vehicles import box_corners

SEEN_WITHIN_M = 20.0
SEEN_FRAMES = 3
"""A spot counts when so many frames had it in sight within so many metres (`autowaze.simulator.truth` says when)."""


@dataclass(frozen=True)
class TrueSpot:
    """One spot at the end of a drive.

    Attributes:
        vehicle: row in the drive's vehicles of the one on it; -1 for none.
        counts: whether the drive could see it well enough to be asked.
        glimpsed: whether any of it was ever in view.
    """

    spot_id: str
    occupied: bool
    vehicle: int
    counts: bool
    glimpsed: bool


@dataclass(frozen=True)
class DriveTruth:
    """Spots and the V vehicles that stood.

    Attributes:
        centre: (V, 2) map metres.
        length, width: (V,) metres.
        heading: (V,) clockwise from north, radians.
    """

    spots: tuple[TrueSpot, ...]
    centre: NDArray[np.float64]
    length: NDArray[np.float64]
    width: NDArray[np.float64]
    heading: NDArray[np.float64]

    @property
    def corners(self) -> NDArray[np.float64]:
        """Outlines (V, 4, 2) of the vehicles."""
        return box_corners(self.centre, self.length, self.width, self.heading)


def read_drive_truth(place: Path) -> DriveTruth:
    """Truth of a simulated drive."""
    folder = place / TRUTH_FOLDER
    vehicles = json.loads((folder / "vehicles.json").read_text(encoding="utf-8"))["vehicles"]
    row_of = {int(v["id"]): row for row, v in enumerate(vehicles)}
    seen_near: dict[str, int] = {}
    for path in sorted((folder / "views").glob("*.json")):
        for spot_id, look in json.loads(path.read_text(encoding="utf-8"))["spots"].items():
            if look["seen"] and look["range_m"] <= SEEN_WITHIN_M:
                seen_near[spot_id] = seen_near.get(spot_id, 0) + 1
    document = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["spots"]
    spots = tuple(
        TrueSpot(
            spot_id,
            bool(said["occupied"]),
            row_of.get(said["vehicle_id"] or 0, -1),
            seen_near.get(spot_id, 0) >= SEEN_FRAMES,
            said["best_visible_fraction"] > 0,
        )
        for spot_id, said in document.items()
    )
    heading = np.array([np.pi / 2 - v["heading_rad"] for v in vehicles])
    centre = np.array([v["center_xyz"][:2] for v in vehicles]).reshape(-1, 2)
    length, width = (np.array([v[name] for v in vehicles], dtype=np.float64) for name in ("length", "width"))
    return DriveTruth(spots, centre, length, width, heading)


def read_labelled_truth(folder: Path, T_map_world: Pose) -> DriveTruth:
    """Truth of a real drive: spots of its `truth.json`, vehicles of its `vehicles.json`.

    Which spots count is what the file says of them; its own rule is 25 m, three frames.

    Raises:
        AutowazeError: a file is missing or of another shape.
    """
    try:
        document = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        vehicles = ParkedVehicle.from_file(folder / "vehicles.json")
        row_of = {vehicle.track_id: row for row, vehicle in enumerate(vehicles)}
        spots = tuple(
            TrueSpot(
                spot_id,
                bool(said["occupied"]),
                row_of.get(said["vehicle_track_id"], -1),
                bool(said["observable"]),
                (said.get("best_visible_fraction") or 0.0) > 0 or bool(said["observable"]),
            )
            for spot_id, said in document.get("spots", document).items()
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise AutowazeError(f"{folder}: truth.json and vehicles.json do not tell what is true: {error}") from error
    ahead = np.array([[np.cos(v.yaw), 0.0, -np.sin(v.yaw)] for v in vehicles]).reshape(-1, 3) @ T_map_world[:3, :3].T
    centre = transform(T_map_world, np.array([v.centre_world for v in vehicles]).reshape(-1, 3))
    return DriveTruth(
        spots,
        centre[:, :2],
        np.array([v.length_m for v in vehicles], dtype=np.float64),
        np.array([v.width_m for v in vehicles], dtype=np.float64),
        np.arctan2(ahead[:, 0], ahead[:, 1]),
    )
