"""What can be set about tracking."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SortSettings:
    """What can be set about tracking.

    Attributes:
        min_iou: least overlap of a detection with the foretold box (paper: IoU_min = 0.3).
        min_iou_waiting: the same for a track that was not seen in the frame before.
        min_iou_elsewhere: the same where the depths contradict each other; the depth may be that of a pole in front.
        min_hits: frames that a track must have been seen in before it is reported.
        max_age: frames without a detection that a track survives (paper: T_Lost = 1).
        max_age_traffic: the same for what moves, was seen in `seasoned` frames or more and did not leave the image: a
            lamp post hides it for as long.
        max_age_in_map: the same for a track whose place in the map is known and in view.
        max_drift: shift of a box per frame over its size, beyond ego motion, up to which the object may be standing.
        min_containment: least share of a detection that lies in the foretold box of a partly hidden object, when
            their depths agree.
        max_apart_m: distance over ground up to which what comes to sight may be another part of a hidden vehicle: half
            a car's length and a bit, well below the pitch at which cars park along a kerb.
        max_across_m: the same across the line of sight, where its depth is unknown.
        min_iou_in_place: least overlap with the box of the frame before of what nothing foretold explains.
    """

    min_iou: float = 0.2
    min_iou_waiting: float = 0.35
    min_iou_elsewhere: float = 0.5
    min_hits: int = 1
    max_age: int = 1
    max_age_traffic: int = 10
    seasoned: int = 5
    max_age_in_map: int = 30
    max_drift: float = 0.12
    min_containment: float = 0.7
    max_apart_m: float = 3.5
    max_across_m: float = 1.5
    min_iou_in_place: float = 0.6
