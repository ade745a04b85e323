"""The spots as clients see them: geometry worked out once, states as believed at the moment of asking."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from autowaze.cloud.api.intake import Intake
from autowaze.cloud.occupancy import vacant_rectangles
from autowaze.cloud.service import CloudService
from autowaze.world.parking import Occupancy, ParkingMap, SpotState

Rectangle = dict[str, float]


@dataclass(frozen=True)
class BelievedSpots:
    """All spots at one time.

    Attributes:
        states: in the order of the parking map.
        now: seconds since the epoch (UTC).
        version: of the map that they follow from.
    """

    states: Sequence[SpotState]
    now: float
    version: int


class SpotBook:
    """Looks spots up for the feeds.

    Args:
        parking_map: the spots.
        intake: where their states are asked for.
        clock: seconds since the epoch (UTC); None stands still at the newest observation, to replay drives of old.
    """

    def __init__(self, parking_map: ParkingMap, intake: Intake, clock: Callable[[], float] | None) -> None:
        self.ids = tuple(spot.id for spot in parking_map.spots)
        self.kinds = tuple(spot.kind for spot in parking_map.spots)
        self.row_of = {spot_id: row for row, spot_id in enumerate(self.ids)}
        polygons = np.array([spot.polygon for spot in parking_map.spots], dtype=np.object_)
        self.rectangles = vacant_rectangles(polygons)
        outlines = shapely.transform(polygons, parking_map.georeference.to_lon_lat)
        self.outlines_lon_lat = shapely.force_2d(np.asarray(shapely.orient_polygons(outlines), dtype=np.object_))
        self.geometries: list[Any] = [json.loads(text) for text in shapely.to_geojson(self._rounded())]
        self.bounds_lon_lat = shapely.bounds(self.outlines_lon_lat)
        self.tree = shapely.STRtree(self.outlines_lon_lat)
        self._intake = intake
        self._clock = clock

    def __len__(self) -> int:
        return len(self.ids)

    async def believed(self) -> BelievedSpots:
        """Every spot as it is believed now."""
        return await self._intake.ask(self._believed)

    def vacant_rectangles(self, spots: BelievedSpots) -> list[Rectangle]:
        """Rectangles of the vacant spots (thesis, sec. 3.3.6)."""
        pairs = zip(self.rectangles, spots.states, strict=True)
        return [rectangle for rectangle, state in pairs if state.occupancy is Occupancy.VACANT]

    def feature(self, row: int, spots: BelievedSpots) -> dict[str, Any]:
        """One spot as a GeoJSON feature."""
        state = spots.states[row]
        seen = state.observed_at
        return {
            "type": "Feature",
            "id": self.ids[row],
            "geometry": self.geometries[row],
            "properties": {
                "spot_id": self.ids[row],
                "kind": self.kinds[row],
                "state": state.occupancy.value,
                "probability": round(state.probability_vacant, 4),
                "observed_at": seen,
                "age_s": None if seen is None else round(max(spots.now - seen, 0.0), 1),
                "rectangle": self.rectangles[row],
            },
        }

    def _believed(self, service: CloudService) -> BelievedSpots:
        if self._clock is None:
            now = max((s.observed_at for s in service.states if s.observed_at is not None), default=0.0)
        else:
            now = self._clock()
        return BelievedSpots(service.states_at(now), now, service.map.version)

    def _rounded(self) -> Any:
        # A centimetre; RFC 7946, sec. 11.2 asks for no more digits than are meant.
        return shapely.transform(self.outlines_lon_lat, lambda lon_lat: np.round(lon_lat, 7))
