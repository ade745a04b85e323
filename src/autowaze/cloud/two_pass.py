"""States of spots by the thesis's method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.ground_votes import GroundVotes
from autowaze.cloud.occupancy import match_two_pass
from autowaze.cloud.scene import VehicleScene
from autowaze.cloud.spots import SpotIndex
from autowaze.world.parking import Occupancy, SpotState

LOOKED_AT_SHARE = 0.2
"""Share of a spot's ground that must have been seen for it to be called vacant."""


def decide_two_pass(
    spots: NDArray[np.int64], index: SpotIndex, scene: VehicleScene, ground: GroundVotes, second_pass: bool = True
) -> list[SpotState]:
    """States of these spots (T,): occupied if a box takes them, else vacant, but only where a car looked.

    What is decided of a spot depends on the boxes that meet it, and for these on the spots that they meet: nothing
    farther away matters.
    """
    boxes = scene.overlapping(index.polygons[spots])
    involved = np.union1d(spots, index.overlapping(boxes.polygons)[1])
    match = match_two_pass(index.polygons[involved], boxes.polygons, second_pass)
    states = []
    for spot, row in zip(spots.tolist(), np.searchsorted(involved, spots).tolist(), strict=True):
        windows = ground.windows(spot)
        observed_at = windows[-1].end if windows else None
        box = int(max(match.first[row], match.second[row]))
        if box >= 0:
            seen_at = float(boxes.seen_at[box])
            found = "stands here" if match.first[row] >= 0 else "overlaps it"
            evidence = f"vehicle {boxes.group[box]} of {boxes.points[box]} points {found}"
            states.append(
                SpotState(index.ids[spot], Occupancy.OCCUPIED, 0.0, max(seen_at, observed_at or 0.0), evidence)
            )
            continue
        share = ground.seen_share(spot)
        evidence = f"no vehicle; {share:.0%} of the ground seen"
        if share >= LOOKED_AT_SHARE:
            states.append(SpotState(index.ids[spot], Occupancy.VACANT, 1.0, observed_at, evidence))
        else:
            states.append(SpotState(index.ids[spot], Occupancy.UNKNOWN, 0.5, observed_at, evidence))
    return states
