"""Spots drawn, redrawn and erased while the service runs.

Edits have their place in the log of diffs: whoever replays both in order arrives at the same states.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from autowaze.cloud.spots import SpotIndex
from autowaze.world.drawn_spots import feature_of, outer_ring
from autowaze.world.errors import AutowazeError, MapFileError
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingSpot
from autowaze.world.spot_check import MOST_OVERLAP, faults_of_shape, is_good_id, overlap_share

KINDS = ("parallel", "perpendicular", "angled", "unknown")


class RefusedEditError(AutowazeError):
    """A spot that cannot be as it was drawn, or an erasure that cannot be; nothing has changed.

    Args:
        faults: one line each.
    """

    def __init__(self, message: str, faults: list[str] | None = None) -> None:
        super().__init__(message)
        self.faults = faults or []


class ClashingEditError(RefusedEditError):
    """An edit that would be fine if other spots lay elsewhere."""


@dataclass(frozen=True)
class SpotEdit:
    """One edit.

    Attributes:
        spot_id: of the spot.
        ring: its closed outer ring, lon and lat in degrees, as it was drawn; None if it is erased.
        kind: parallel, perpendicular, angled or unknown.
        position: of the last diff before the edit, in the log.
    """

    spot_id: str
    ring: tuple[tuple[float, float], ...] | None
    kind: str = "unknown"
    position: int = 0

    def spot(self, georeference: Georeference) -> ParkingSpot | None:
        """The spot in map metres; None if it is erased."""
        if self.ring is None:
            return None
        return ParkingSpot(self.spot_id, shapely.Polygon(georeference.to_map(np.array(self.ring))[:, :2]), self.kind)

    def encoded(self) -> bytes:
        """The edit as a GeoJSON feature; one without geometry erases."""
        feature: dict[str, Any] = {"type": "Feature", "id": self.spot_id, "geometry": None, "properties": {}}
        if self.ring is not None:
            feature["geometry"] = {"type": "Polygon", "coordinates": [self.ring]}
            feature["properties"] = {"spot_id": self.spot_id, "kind": self.kind}
        return json.dumps({**feature, "position": self.position}, separators=(",", ":")).encode()

    @classmethod
    def decoded(cls, data: bytes) -> SpotEdit:
        """The edit that was encoded."""
        feature = json.loads(data)
        ring = None
        if feature["geometry"] is not None:
            ring = tuple((float(lon), float(lat)) for lon, lat in feature["geometry"]["coordinates"][0])
        kind = feature["properties"].get("kind", "unknown")
        return cls(str(feature["id"]), ring, kind, int(feature["position"]))


def drawing(spot_id: str, feature: Any) -> SpotEdit:
    """The edit that a client asks for with a GeoJSON feature.

    Raises:
        RefusedEditError: it is no polygon, or of an unknown kind, or the id cannot be one.
    """
    if not is_good_id(spot_id):
        raise RefusedEditError("this cannot be the id of a spot: use up to 200 printable characters without a slash")
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise RefusedEditError("expected a GeoJSON Feature")
    try:
        ring = outer_ring(feature, f"spot {spot_id}")
    except MapFileError as error:
        raise RefusedEditError(str(error)) from error
    if len(feature["geometry"]["coordinates"]) > 1:
        raise RefusedEditError("a spot has no holes")
    properties = feature.get("properties")
    properties = properties if isinstance(properties, dict) else {}
    named = properties.get("spot_id", spot_id)
    if named != spot_id:
        raise RefusedEditError(f"spot {spot_id}: properties.spot_id says {str(named)[:100]!r}")
    kind = properties.get("kind") or "unknown"
    if kind not in KINDS:
        raise RefusedEditError(f"spot {spot_id}: kind is one of {', '.join(KINDS)}")
    if (ring[0] != ring[-1]).any():
        raise RefusedEditError(f"spot {spot_id}: the ring is not closed: repeat its first position as its last")
    if shapely.LinearRing(ring).is_ccw is False:
        ring = ring[::-1]
    return SpotEdit(spot_id, tuple((float(lon), float(lat)) for lon, lat in ring), str(kind))


def check_edit(edit: SpotEdit, spots: SpotIndex) -> None:
    """Refuse what `autowaze spots check` would complain of.

    Raises:
        ClashingEditError: it lies on other spots, or it would erase the last one.
        RefusedEditError: the outline is no spot, wherever others lie.
    """
    spot = edit.spot(spots.georeference)
    if spot is None:
        if len(spots) == 1:
            raise ClashingEditError(f"spot {edit.spot_id} is the last one: a service needs a spot")
        return
    if faults := [f"{fault}: {detail}" for fault, detail in faults_of_shape(spot.polygon)]:
        raise RefusedEditError(f"spot {edit.spot_id} cannot be so", faults)
    rows = spots.around(np.array(spot.polygon.bounds))
    rows = rows[[spots.ids[row] != edit.spot_id for row in rows.tolist()]] if len(rows) else rows
    share = overlap_share(spots.polygons[rows], np.full(len(rows), spot.polygon, dtype=np.object_))
    bad = np.flatnonzero(share > MOST_OVERLAP)
    if len(bad):
        lines = [f"overlap: {share[i]:.0%} lies on spot {spots.ids[rows[i]]}" for i in bad.tolist()]
        raise ClashingEditError(f"spot {edit.spot_id} lies on other spots", lines)


def feature_of_spot(spot: ParkingSpot, georeference: Georeference) -> dict[str, Any]:
    """A spot as a plain GeoJSON feature, as parking maps have it."""
    ring = georeference.to_lon_lat(shapely.get_coordinates(shapely.orient_polygons(spot.polygon).exterior))
    return feature_of(spot.id, spot.kind, ring)
