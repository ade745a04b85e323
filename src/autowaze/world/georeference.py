"""Where the map's east-north-up frame lies on the Earth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import AutowazeError
from autowaze.world.pose import Pose, make_pose

_AXES_M = 1000.0
"""Length of the axes that are carried from one frame to another; longer ones round less."""


@dataclass(frozen=True)
class Georeference:
    """Origin of the local tangent plane: WGS84 degrees and metres above the ellipsoid."""

    lat_deg: float
    lon_deg: float
    altitude_m: float = 0.0

    def __post_init__(self) -> None:
        if not (abs(self.lat_deg) < 89.9 and abs(self.lon_deg) <= 180.0 and math.isfinite(self.altitude_m)):
            raise AutowazeError(f"impossible georeference {self.lat_deg}, {self.lon_deg}: use WGS84 degrees")

    @cached_property
    def _to_local(self):  # type: ignore[no-untyped-def]
        from pyproj import Transformer

        pipeline = (
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 +lat_0={self.lat_deg!r} +lon_0={self.lon_deg!r} "
            f"+h_0={self.altitude_m!r}"
        )
        return Transformer.from_pipeline(pipeline)

    def to_map(self, lon_lat: NDArray[np.floating], altitude_m: float | None = None) -> NDArray[np.float64]:
        """East, north, up (N, 3) in metres of points (N, 2) in lon, lat degrees."""
        lon_lat = np.asarray(lon_lat, dtype=np.float64).reshape(-1, 2)
        heights = np.full(len(lon_lat), self.altitude_m if altitude_m is None else altitude_m)
        east, north, up = self._to_local.transform(lon_lat[:, 0], lon_lat[:, 1], heights)
        return np.stack([east, north, up], axis=1)

    def pose_of(self, other: Georeference) -> Pose:
        """T_self_other: takes coordinates of another map frame to this one's."""
        lon, lat, height = other._to_local.transform(*(_AXES_M * np.eye(3, 4)), direction="INVERSE")
        points = np.stack(self._to_local.transform(lon, lat, height))
        return make_pose((points[:, :3] - points[:, 3:]) / _AXES_M, points[:, 3])

    def to_lon_lat(self, points_map: NDArray[np.floating]) -> NDArray[np.float64]:
        """Lon, lat (N, 2) in degrees of points (N, 2) or (N, 3) in map metres."""
        points = np.asarray(points_map, dtype=np.float64)
        up = points[:, 2] if points.shape[1] > 2 else np.zeros(len(points))
        lon, lat, _ = self._to_local.transform(points[:, 0], points[:, 1], up, direction="INVERSE")
        return np.stack([lon, lat], axis=1)
