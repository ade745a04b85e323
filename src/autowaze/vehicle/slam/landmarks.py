"""The 3D features that tracking holds on to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.world.feature_map import MapFeatures
from autowaze.world.features import DESCRIPTOR_BYTES, CameraFeatures

NO_LANDMARK = -1

_COLUMNS: dict[str, tuple[Any, tuple[int, ...]]] = {
    "id": (np.int64, ()),
    "position": (np.float64, (3,)),
    "descriptor": (np.uint8, (DESCRIPTOR_BYTES,)),
    "normal": (np.float32, (3,)),
    "min_distance": (np.float32, ()),
    "max_distance": (np.float32, ()),
    "label": (np.uint8, ()),
    "instance": (np.int32, ()),
    "n_visible": (np.int32, ()),
    "n_found": (np.int32, ()),
    "n_observations": (np.int32, ()),
    "first_seen": (np.float64, ()),
    "last_seen": (np.float64, ()),
    "map_id": (np.uint64, ()),
}


class Landmarks:
    """Struct of arrays with growing capacity; rows are sorted by id.

    Attributes (N rows each):
        id: (N,) int64, counted from 1, never reused.
        position: (N, 3) float64, metres, map frame; refined by bundle adjustment unless the landmark is stored.
        descriptor: (N, 32) uint8, as seen from the latest keyframe.
        normal: (N, 3) float32, mean unit vector from the landmark to the cameras that saw it.
        min_distance, max_distance: (N,) float32, metres between which its ORB scale can be detected.
        label: (N,) uint8, the `ClassLabel` last seen; instance: (N,) int32, the track id last seen, 0 for none.
        n_visible, n_found: (N,) int32, frames in which it was predicted visible, and matched as an inlier.
        n_observations: (N,) int32, keyframes that saw it.
        first_seen, last_seen: (N,) float64, seconds since the epoch.
        map_id: (N,) uint64, its id in the stored map; 0 for a landmark of this drive.
    """

    id: NDArray[np.int64]
    position: NDArray[np.float64]
    descriptor: NDArray[np.uint8]
    normal: NDArray[np.float32]
    min_distance: NDArray[np.float32]
    max_distance: NDArray[np.float32]
    label: NDArray[np.uint8]
    instance: NDArray[np.int32]
    n_visible: NDArray[np.int32]
    n_found: NDArray[np.int32]
    n_observations: NDArray[np.int32]
    first_seen: NDArray[np.float64]
    last_seen: NDArray[np.float64]
    map_id: NDArray[np.uint64]

    def __init__(self, capacity: int = 1 << 14) -> None:
        self._store = {name: np.zeros((capacity, *shape), dtype) for name, (dtype, shape) in _COLUMNS.items()}
        self._row_of_id = np.full(capacity + 2, NO_LANDMARK, np.int64)  # of ids from `_base` on, between two blanks
        self._base = 1
        self._n_below = 0  # rows whose ids lie below it
        self._next_id = 1
        self._count = 0
        self._bind()

    def __len__(self) -> int:
        return self._count

    @property
    def capacity(self) -> int:
        """Rows and ids that memory is taken for."""
        return max(len(self._store["id"]), len(self._row_of_id))

    @property
    def is_stored(self) -> NDArray[np.bool_]:
        """(N,) which landmarks belong to the stored map; their positions stay as they are."""
        return np.asarray(self.map_id != 0)

    def add(self, **columns: NDArray[Any]) -> NDArray[np.int64]:
        """Append rows; columns not given are zero. Returns the new ids (n,)."""
        n = len(columns["position"])
        start, stop = self._count, self._count + n
        self._reserve(stop)
        for name, store in self._store.items():
            store[start:stop] = columns.get(name, 0)
        ids = np.arange(self._next_id, self._next_id + n, dtype=np.int64)
        self._store["id"][start:stop] = ids
        self._next_id += n
        self._count = stop
        self._bind()
        self._file_new(ids, start)
        return ids

    def add_stored(self, features: MapFeatures) -> NDArray[np.int64]:
        """Append features of the stored map. Returns their landmark ids (n,)."""
        return self.add(
            position=features.position,
            descriptor=features.descriptor,
            normal=features.normal,
            min_distance=features.min_distance,
            max_distance=features.max_distance,
            label=features.label,
            n_observations=features.observations,
            first_seen=features.first_seen,
            last_seen=features.last_seen,
            map_id=features.id,
        )

    def rows(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Row numbers of ids; -1 for ids that were culled or never given."""
        rows = np.asarray(self._row_of_id.take(ids - (self._base - 1), mode="clip"))
        if self._n_below:
            below = np.flatnonzero((ids < self._base) & (ids > 0))
            rows[below] = self._rows_below(ids[below])
        return rows

    def remove(self, gone: NDArray[np.bool_]) -> None:
        """Drop the rows of a mask (N,); the others keep their order and ids, not their row numbers."""
        if not gone.any():
            return
        first = int(gone.argmax())
        keep = np.flatnonzero(~gone[first:]) + first
        self._file(self.id[first:], NO_LANDMARK)
        for store in self._store.values():
            store[first : first + len(keep)] = store[keep]
        self._count = first + len(keep)
        self._bind()
        self._n_below = int(np.searchsorted(self.id, self._base))
        self._file(self.id[first:], np.arange(first, self._count))

    def count_sightings(
        self,
        visible_row: NDArray[np.int64],
        landmark_id: NDArray[np.int64],
        features: CameraFeatures,
        timestamp: float,
    ) -> None:
        """Note what one frame should have seen (M,), and what its features (N) found: ids (N,), -1 for none."""
        self.n_visible[visible_row] += 1
        seen = np.flatnonzero(landmark_id >= 0)
        rows = self.rows(landmark_id[seen])
        self.n_found[rows] += 1
        self.last_seen[rows] = timestamp
        own = ~self.is_stored[rows]
        self.label[rows[own]] = features.label[seen[own]]
        self.instance[rows] = features.instance_id[seen]

    def _rows_below(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Row numbers of ids from before the table: those of a stored map."""
        low = self.id[: self._n_below]
        if low[-1] - low[0] == len(low) - 1:
            at = np.clip(ids - low[0], 0, len(low) - 1)
        else:
            at = np.minimum(np.searchsorted(low, ids), len(low) - 1)
        return np.where(low[at] == ids, at, NO_LANDMARK)

    def _file(self, ids: NDArray[np.int64], rows: NDArray[np.int64] | int) -> None:
        """Note where ids stand; those below the table need no note."""
        in_table = ids >= self._base
        self._row_of_id[ids[in_table] - (self._base - 1)] = rows if np.ndim(rows) == 0 else rows[in_table]  # type: ignore[index]

    def _file_new(self, ids: NDArray[np.int64], first_row: int) -> None:
        """Note that these new ids stand in consecutive rows; the table follows the ids that are alive."""
        if self._next_id - self._base + 2 > len(self._row_of_id):
            own = np.flatnonzero(~self.is_stored[:first_row])
            self._base = int(self.id[own[0]]) if len(own) else int(ids[0])
            self._n_below = int(np.searchsorted(self.id, self._base))
            size = max(2 * (self._next_id - self._base + 2), len(self._row_of_id) // 2)
            self._row_of_id = np.full(size, NO_LANDMARK, np.int64)
            self._file(self.id, np.arange(self._count))
        else:
            self._file(ids, np.arange(first_row, first_row + len(ids)))

    def _reserve(self, size: int) -> None:
        capacity = len(self._store["id"])
        if size <= capacity:
            return
        while capacity < size:
            capacity *= 2
        for name, store in self._store.items():
            grown = np.zeros((capacity, *store.shape[1:]), store.dtype)
            grown[: self._count] = store[: self._count]
            self._store[name] = grown

    def _bind(self) -> None:
        for name, store in self._store.items():
            setattr(self, name, store[: self._count])
