"""What OpenStreetMap's tags say of parking along a street, in the scheme of 2022 and in the older one.

https://wiki.openstreetmap.org/wiki/Street_parking and https://wiki.openstreetmap.org/wiki/Key:parking:lane
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum

SIDES = ("left", "right")
FORBIDDING_RESTRICTIONS = ("no_parking", "no_stopping", "no_standing", "no_waiting", "loading_only", "charging_only")
CLOSED_ACCESS = ("no", "private")
_ORIENTATIONS = {
    "parallel": "parallel",
    "inline": "parallel",
    "diagonal": "angled",
    "perpendicular": "perpendicular",
    "orthogonal": "perpendicular",
}
_POSITIONS_BEFORE = {
    "on_street": "lane",
    "painted_area_only": "lane",
    "half_on_kerb": "half_on_kerb",
    "on_kerb": "on_kerb",
    "lay_by": "street_side",
    "street_side": "street_side",
    "shoulder": "shoulder",
}
_FORBIDDING_BEFORE = ("no", "no_parking", "no_stopping", "no_standing", "fire_lane")
MOST_CAPACITY = 10_000


class Position(StrEnum):
    """Where cars stand, seen from the carriageway."""

    LANE = "lane"
    STREET_SIDE = "street_side"
    ON_KERB = "on_kerb"
    HALF_ON_KERB = "half_on_kerb"
    SHOULDER = "shoulder"


@dataclass(frozen=True)
class KerbRule:
    """How cars may park on one side of a street.

    Attributes:
        kind: parallel, perpendicular or angled.
        capacity: how many, if it was counted.
        back_in: cars in angled bays stand with their tail to the kerb.
    """

    position: Position
    kind: str
    capacity: int | None = None
    back_in: bool = False


def kerb_rule(tags: dict[str, str], side: str) -> KerbRule | str | None:
    """The rule of one side (left or right of the way's direction); a text says why nobody parks; None: untold."""
    told = _told(tags, "parking", side)
    return _rule_now(tags, side, told) if told is not None else _rule_before(tags, side)


def is_closed(tags: dict[str, str], prefix: str = "") -> bool:
    """Whether the public may not park: access, or the restriction that stands in for it."""
    return tags.get(f"{prefix}access") in CLOSED_ACCESS or tags.get(f"{prefix}restriction") in FORBIDDING_RESTRICTIONS


def kind_of(orientation: str | None) -> str | None:
    """Our word for an orientation; None for one that is missing or unknown."""
    return _ORIENTATIONS.get(orientation or "")


def whole_number(text: str | None) -> int | None:
    """A capacity; None if it is missing or nonsense."""
    if text is None or not re.fullmatch(r"\d{1,5}", text.strip()):
        return None
    number = int(text)
    return number if 0 < number <= MOST_CAPACITY else None


def metres(text: str | None) -> float | None:
    """A length such as `5.5`, `5,5 m` or `18'`; None if it is missing or nonsense."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d{1,4}(?:[.,]\d{1,3})?)\s*(m|'|ft)?", text.strip())
    if found is None:
        return None
    value = float(found[1].replace(",", "."))
    return value * 0.3048 if found[2] in ("'", "ft") else value


def _told(tags: dict[str, str], key: str, side: str, detail: str = "") -> str | None:
    """The value for a side; `both` stands for either."""
    return tags.get(f"{key}:{side}{detail}", tags.get(f"{key}:both{detail}"))


def _rule_now(tags: dict[str, str], side: str, told: str) -> KerbRule | str | None:
    if told == "separate":
        return None  # drawn as an area of its own
    if told == "no":
        return "parking=no"
    restriction = _told(tags, "parking", side, ":restriction")
    if restriction in FORBIDDING_RESTRICTIONS:
        return f"restriction={restriction}"
    access = _told(tags, "parking", side, ":access")
    if access in CLOSED_ACCESS:
        return f"access={access}"
    position = Position.LANE if told == "yes" else next((p for p in Position if p == told), None)
    if position is None:
        return f"unknown value parking={told[:30]}"
    kind = kind_of(_told(tags, "parking", side, ":orientation")) or "parallel"
    back_in = _told(tags, "parking", side, ":direction") == "back_in"
    return KerbRule(position, kind, whole_number(_told(tags, "parking", side, ":capacity")), back_in)


def _rule_before(tags: dict[str, str], side: str) -> KerbRule | str | None:
    lane = _told(tags, "parking:lane", side)
    if lane is None or lane == "separate":
        return None
    condition = _told(tags, "parking:condition", side)
    if lane in _FORBIDDING_BEFORE:
        return f"parking:lane={lane}"
    if condition in ("private", *_FORBIDDING_BEFORE):
        return f"parking:condition={condition}"
    if lane == "marked":
        return KerbRule(Position.LANE, "parallel")
    kind = kind_of(lane)
    if kind is None:
        return f"unknown value parking:lane={lane[:30]}"
    where = _told(tags, "parking:lane", side, f":{lane}") or "on_street"
    position = Position(_POSITIONS_BEFORE.get(where, "lane"))
    return KerbRule(position, kind, whole_number(_told(tags, "parking:lane", side, ":capacity")))
