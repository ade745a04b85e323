"""What can be set about loop closing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Places, their recognition, and when a loop is closed.

    Attributes:
        place_distance_m, place_angle_rad: a keyframe so far from the last place is the next one.
        features_per_place: as many are kept, those that the most keyframes saw.
        max_places: from then on the oldest give up their features and keep their poses alone.
        min_path_m: two places closer along the path are no loop.
        view_m: two cameras this far apart may see the same things; the uncertainty of the pose adds three sigmas.
        max_turn_rad: and they look in directions no further apart.
        min_likeness: to an earlier place, as a share of that to the place just before.
        n_candidates: so many of the most similar places are verified by their geometry.
        n_around: places before and after a candidate whose landmarks count as its own.
        min_inliers: features that make certain of a loop.
        n_consistent: places in a row that must find themselves in the same way.
        consistency_m, consistency_rad: how far two such findings may be apart after the odometry between them.
        n_window, n_held: the latest places are adjusted together as the drive goes on, the first of them held.
        window_every: places after which that is done again.
        n_loose: the last of them do not take part, they move along.
        window_iterations: of that adjustment, in each of its rounds.
        search_frames, closing_frames, adjustment_frames: after so many frames a result is applied, whenever it was
            ready; the adjustment takes another frame per `places_per_frame` places.
        leave_places: the drive is adjusted as a whole after so many places without another loop.
    """

    place_distance_m: float = 1.5
    place_angle_rad: float = 0.2
    features_per_place: int = 700
    max_places: int = 2000
    min_path_m: float = 40.0
    view_m: float = 15.0
    max_turn_rad: float = 0.8
    min_likeness: float = 0.1
    n_candidates: int = 3
    n_around: int = 3
    min_inliers: int = 60
    n_consistent: int = 3
    consistency_m: float = 0.3
    consistency_rad: float = 0.03
    n_window: int = 10
    n_held: int = 3
    window_every: int = 2
    n_loose: int = 1
    window_iterations: int = 3
    search_frames: int = 3
    closing_frames: int = 5
    adjustment_frames: int = 20
    places_per_frame: int = 10
    leave_places: int = 6
