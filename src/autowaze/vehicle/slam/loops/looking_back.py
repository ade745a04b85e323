"""What each new place brings: the latest places adjusted together, and the search for earlier ones like it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.loops.adjustment import adjust_places
from autowaze.vehicle.slam.loops.place import Place
from autowaze.vehicle.slam.loops.recognition import PlaceIndex
from autowaze.vehicle.slam.loops.settings import LoopSettings
from autowaze.vehicle.slam.loops.verification import Loop, verify
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.small_matrices import orthonormal
from autowaze.world.camera import StereoCamera
from autowaze.world.pose import inverse

SeenBack = tuple[int, NDArray[np.float64], list[Loop]]
"""Number of the first place adjusted, the poses (W, 4, 4) from it on, and loops that are not confirmed yet."""


class LookingBack:
    """Work for a thread of its own; places come in the order of the drive."""

    def __init__(self, camera: StereoCamera, settings: SlamSettings) -> None:
        self.camera = camera
        self.settings = settings
        self._index = PlaceIndex()

    @property
    def n_places(self) -> int:
        """Places that were searched for."""
        return len(self._index)

    def forget(self, place: int) -> None:
        """Find a place no more."""
        self._index.forget(place)

    def __call__(self, places: list[Place], first: int) -> SeenBack:
        """The latest places adjusted together, from which on (W, 4, 4), and the loops of those from `first` on."""
        s = self.settings.loops
        T = np.stack([place.T_map_cam for place in places])
        if len(places) // s.window_every == first // s.window_every:
            return len(places), T[:0], self._search(places, T, first)
        start = max(len(places) - s.n_window, 0)
        n_held = s.n_held if start else 1
        window = adjust_places(
            places[start:], T[start:], [], self.camera, self.settings, n_held, s.window_iterations, is_final=False
        )
        # The last ones are held from one side only: they follow, as the odometry has them.
        firm = max(len(window) - s.n_loose, 1)
        window[firm:] = window[firm - 1] @ inverse(T[start + firm - 1]) @ T[start + firm :]
        window[:, :3, :3] = orthonormal(window[:, :3, :3])
        T[start:] = window
        return start, window, self._search(places, T, first)

    def _search(self, places: list[Place], T: NDArray[np.float64], first: int) -> list[Loop]:
        """Loops from the places from `first` on back to earlier ones, the surest of each."""
        s = self.settings.loops
        path_m = np.array([place.path_m for place in places])
        found = []
        for later in range(first, len(places)):
            self._index.add(places[later].features.descriptor)
            loops = [
                verify(places, earlier, later, s.n_around, s.min_inliers, self.camera, self.settings)
                for earlier in self._alike(later, _reachable(T, path_m, later, places[later].sigma_m, s))
            ]
            found += sorted([loop for loop in loops if loop], key=lambda loop: -loop.n_inliers)[:1]
        return found

    def _alike(self, later: int, candidates: NDArray[np.int64]) -> list[int]:
        """The candidates most like a place, neighbours left out, that are as alike as a place seen again is."""
        s = self.settings.loops
        if not len(candidates):
            return []
        likeness = self._index.likeness(later, candidates)
        enough = s.min_likeness * self._index.likeness(later, np.array([later - 1]))[0]
        chosen: list[int] = []
        for i in np.argsort(-likeness, kind="stable"):
            apart = all(abs(int(candidates[i]) - other) > s.n_around for other in chosen)
            if likeness[i] >= enough and apart and len(chosen) < s.n_candidates:
                chosen.append(int(candidates[i]))
        return chosen


def _reachable(
    T_map_cam: NDArray[np.float64], path_m: NDArray[np.float64], later: int, sigma_m: float, settings: LoopSettings
) -> NDArray[np.int64]:
    """Earlier places that a place may be, going by its pose and by how uncertain that is."""
    earlier = T_map_cam[:later]
    offset = np.linalg.norm(earlier[:, :3, 3] - T_map_cam[later, :3, 3], axis=1)
    cosine = earlier[:, :3, 2] @ T_map_cam[later, :3, 2]
    return np.flatnonzero(
        (path_m[later] - path_m[:later] > settings.min_path_m)
        & (offset < settings.view_m + 3.0 * sigma_m)
        & (cosine > np.cos(settings.max_turn_rad))
    )
