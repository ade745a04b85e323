"""What passes of cars saw, as CDS events."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import shapely

from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.spot_sheet import SpotSheet
from autowaze.cloud.api.zones import Kerb, cds_id
from autowaze.cloud.passes import Happening, Kind, PassJournal


@dataclass(frozen=True)
class Event:
    """One event.

    Attributes:
        number: of the happening; newer ones have higher numbers.
        shape: outline of the space in map metres.
        document: as CDS has it.
    """

    number: int
    shape: shapely.Geometry
    document: dict[str, Any]


class Events:
    """Tells the journal in CDS.

    Args:
        journal: is asked in the thread of the intake, which feeds it.
    """

    def __init__(self, journal: PassJournal, intake: Intake) -> None:
        self._journal = journal
        self._intake = intake

    async def told(self, now: float) -> list[Happening]:
        """What is over by now, oldest first."""
        return await self._intake.ask(lambda service: self._journal.happenings(now))

    def select(
        self,
        told: list[Happening],
        sheet: SpotSheet,
        zone_id: str | None,
        space_id: str | None,
        hour: str | None,
        before: int | None,
    ) -> list[Event]:
        """Events at spots of this sheet, newest first, that fit what is given."""
        chosen, kerb = [], sheet.kerb
        for happening in reversed(told):
            row = sheet.row_of.get(happening.sighting.state.spot_id)
            if row is None:  # it was erased since
                continue
            if before is not None and happening.number >= before:
                continue
            if zone_id is not None and kerb.zone_of[row].id != zone_id:
                continue
            if space_id is not None and kerb.space_ids[row] != space_id:
                continue
            if hour is not None and _utc(happening.sighting.observed_at).strftime("%Y-%m-%dT%H") != hour:
                continue
            chosen.append(Event(happening.number, kerb.polygons[row], _document(happening, kerb, row)))
        return chosen


def _document(happening: Happening, kerb: Kerb, row: int) -> dict[str, Any]:
    sighting = happening.sighting
    zone = kerb.zone_of[row]
    place = kerb.polygons[row].centroid
    lon, lat = kerb.georeference.to_lon_lat(shapely.get_coordinates(place))[0]
    observed_ms = round(1000 * sighting.observed_at)
    state = sighting.state
    custom = {"state": state.occupancy.value, "probability": f"{state.probability_vacant:.4f}"}
    if happening.kind is not Kind.REPORT:
        custom |= {
            "not_before_ms": str(round(1000 * (happening.not_before or 0.0))),
            "not_after_ms": str(observed_ms),
        }
    return {
        "event_id": cds_id("event", kerb.georeference, f"{state.spot_id} {sighting.observed_at!r}"),
        "event_type": happening.kind.value,
        "event_location": {"type": "Point", "coordinates": [round(float(lon), 7), round(float(lat), 7)]},
        "event_time": observed_ms,
        "event_publication_time": round(1000 * sighting.received_at),
        "curb_zone_id": zone.id,
        "curb_space_id": kerb.space_ids[row],
        "data_source_type": "camera",
        # Names the fleet, not the car, and not for longer than a day.
        "data_source_device_id": cds_id("device", kerb.georeference, f"{_utc(sighting.observed_at):%Y-%m-%d}"),
        "custom_attributes": custom,
    }


def _utc(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)
