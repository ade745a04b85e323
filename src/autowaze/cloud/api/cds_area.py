"""What part of the city a CDS client asks for."""

from __future__ import annotations

from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

import numpy as np
import shapely

from autowaze.cloud.api.problems import ProblemError
from autowaze.world.georeference import Georeference


@dataclass(frozen=True)
class Area:
    """What part of the city is asked for: a box, or a radius around a point; nothing for all of it.

    Attributes:
        box: in lon/lat degrees, for a large one is no polygon on the map's plane.
        point: in map metres.
    """

    georeference: Georeference
    box: shapely.Polygon | None = None
    point: shapely.Point | None = None
    radius_m: float = 0.0

    def chosen(self, shapes: list[tuple[Any, shapely.Geometry]]) -> list[Any]:
        """The items whose shape, in map metres, lies in the area; nearest first around a point."""
        if self.box is not None:
            outlines = np.array([shape for _, shape in shapes], dtype=np.object_)
            inside = shapely.intersects(shapely.transform(outlines, self.georeference.to_lon_lat), self.box)
            return [item for (item, _), chosen in zip(shapes, inside, strict=True) if chosen]
        if self.point is not None:
            near = [(shapely.distance(shape, self.point), n, item) for n, (item, shape) in enumerate(shapes)]
            return [item for distance, _, item in sorted(near, key=lambda t: t[:2]) if distance <= self.radius_m]
        return [item for item, _ in shapes]


def area_asked_for(
    georeference: Georeference,
    box: tuple[float | None, ...],
    point: tuple[float | None, float | None],
    radius_cm: int | None,
) -> Area:
    """The area that parameters name; raises `ProblemError` 400 where they name none, or two."""
    longitudes, latitudes = (box[0], box[2], point[0]), (box[1], box[3], point[1])
    limits = [(value, 180.0) for value in longitudes] + [(value, 90.0) for value in latitudes]
    if any(value is not None and not abs(value) <= most for value, most in limits):
        raise ProblemError(HTTPStatus.BAD_REQUEST, "bad_parameter", "degrees out of range")
    around = [*point, radius_cm]
    if not any(value is not None for value in [*box, *around]):
        return Area(georeference)
    if all(value is not None for value in box) and not any(value is not None for value in around):
        west, south, east, north = (float(value or 0.0) for value in box)
        return Area(georeference, box=shapely.box(west, south, east, north))
    if all(value is not None for value in around) and not any(value is not None for value in box):
        lng, lat = (float(value or 0.0) for value in point)
        x, y = georeference.to_map(shapely.get_coordinates(shapely.Point(lng, lat)))[0, :2]
        return Area(georeference, point=shapely.Point(x, y), radius_m=(radius_cm or 0) / 100.0)
    raise ProblemError(
        HTTPStatus.BAD_REQUEST, "bad_parameter", "give min_lat, min_lng, max_lat, max_lng, or lat, lng, radius"
    )
