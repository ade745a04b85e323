"""The box that a client asks for, as OGC API Features has it."""

from __future__ import annotations

import math
from http import HTTPStatus
from typing import Annotated

import numpy as np
import shapely
from fastapi import Query

from autowaze.cloud.api.problems import ProblemError

BBOX = Annotated[str | None, Query(max_length=200, description="west,south,east,north in degrees")]


def box_asked_for(text: str) -> shapely.Geometry:
    """The box in lon/lat; one whose west lies east of its east crosses the antimeridian.

    Raises:
        ProblemError: 400, it is no box.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) == 6:  # with heights, which nothing here has
        numbers = [*numbers[:2], *numbers[3:5]]
    if len(numbers) != 4 or not all(map(math.isfinite, numbers)) or numbers[1] > numbers[3]:
        raise ProblemError(HTTPStatus.BAD_REQUEST, "bad_parameter", "bbox: expected west,south,east,north in degrees")
    west, south, east, north = np.clip(numbers, [-360, -90, -360, -90], [360, 90, 360, 90]).tolist()
    edges = [(west, east)] if west <= east else [(west, 180.0), (-180.0, east)]
    return shapely.MultiPolygon([shapely.box(left, south, right, north) for left, right in edges])
