"""Named streets.

`town-a` and `town-b` play the two 15-spot blocks that the thesis drove in CARLA's Town 10; `gold`, `langslow`,
`stewart` and `lot-b` play its real streets and car park: alike in kind and size, not surveyed copies.
"""

from __future__ import annotations

from typing import Any

_ZED = {"name": "zed2i-720", "mount_height_m": 1.65}

PRESETS: dict[str, dict[str, Any]] = {
    "town-a": {
        "seed": 101,
        "length_m": 84.0,
        "frontage": "mixed",
        "heading_deg": 20.0,
        "rows": [
            {"side": "right", "kind": "parallel", "count": 8, "driveways_after": [4]},
            {"side": "left", "kind": "parallel", "count": 7, "start_m": 4.0, "driveways_after": [3]},
        ],
        "parking": {"kinds": ["city", "hatch", "sedan", "estate", "suv", "minivan", "pickup", "sports"]},
        "traffic": {"oncoming": 1, "pedestrians": 3},
    },
    "town-b": {
        "seed": 202,
        "layout": "curved",
        "turn_deg": 14.0,
        "length_m": 76.0,
        "frontage": "shops",
        "heading_deg": 115.0,
        "rows": [
            {"side": "right", "kind": "perpendicular", "count": 9, "driveways_after": [5]},
            {"side": "left", "kind": "parallel", "count": 6, "start_m": 3.0, "driveways_after": [3]},
        ],
        "parking": {"kinds": ["city", "hatch", "sedan", "estate", "suv", "minivan", "pickup", "sports"]},
        "traffic": {"oncoming": 1, "pedestrians": 3},
    },
    "gold": {
        "seed": 303,
        "length_m": 130.0,
        "frontage": "houses",
        "trees": 0.8,
        "heading_deg": 85.0,
        "rows": [{"side": "right", "kind": "parallel", "count": 14, "driveways_after": [3, 6, 9, 12], "pitch_m": 6.1}],
        "parking": {"occupancy": 0.6},
        "light": {"solar_time": 10.5, "weather": "hazy"},
        "rig": _ZED,
    },
    "langslow": {
        "seed": 404,
        "layout": "curved",
        "turn_deg": -20.0,
        "length_m": 120.0,
        "frontage": "houses",
        "trees": 0.6,
        "heading_deg": 190.0,
        "rows": [
            {"side": "right", "kind": "parallel", "count": 8, "driveways_after": [2, 5], "pitch_m": 6.1},
            {"side": "left", "kind": "parallel", "count": 8, "start_m": 6.0, "driveways_after": [3, 6], "pitch_m": 6.1},
        ],
        "parking": {"occupancy": 0.65},
        "light": {"weather": "overcast"},
        "rig": _ZED,
    },
    "stewart": {
        "seed": 505,
        "length_m": 110.0,
        "frontage": "mixed",
        "trees": 0.4,
        "heading_deg": 280.0,
        "rows": [
            {"side": "right", "kind": "parallel", "count": 12, "driveways_after": [4, 8]},
            {"side": "left", "kind": "angled", "count": 14, "start_m": 5.0, "driveways_after": [7]},
        ],
        "parking": {"occupancy": 0.7},
        "light": {"solar_time": 16.8},
        "traffic": {"oncoming": 2, "pedestrians": 5},
        "rig": _ZED,
    },
    "lot-b": {
        "seed": 606,
        "layout": "lot",
        "length_m": 80.0,  # the thesis's lot is 80 m x 30 m, sec. 4.4
        "frontage": "mixed",
        "trees": 0.5,
        "heading_deg": 150.0,
        # bays of nine feet between double lines
        "rows": [
            {"road": road, "side": side, "kind": "perpendicular", "count": 23, "pitch_m": 2.75}
            for road in (0, 1)
            for side in ("left", "right")
        ],
        "parking": {"occupancy": 0.7},
        "traffic": {"oncoming": 0, "pedestrians": 4, "cyclists": 0, "crossing_pedestrians": 1},
        "light": {"solar_time": 12.5},
        "rig": _ZED,
    },
    "loop": {
        "seed": 707,
        "layout": "block",
        "length_m": 130.0,
        "depth_m": 80.0,
        "frontage": "mixed",
        "heading_deg": 10.0,
        "traffic": {"oncoming": 3, "crossing": 2, "pedestrians": 8, "cyclists": 2},
    },
    "suburb": {
        "seed": 808,
        "layout": "curved",
        "turn_deg": 30.0,
        "length_m": 110.0,
        "frontage": "houses",
        "trees": 0.9,
        "rows": [
            {"side": "right", "kind": "parallel", "count": 10, "driveways_after": [3, 6], "pitch_m": 6.1},
            {
                "side": "left",
                "kind": "parallel",
                "count": 10,
                "start_m": 4.0,
                "driveways_after": [2, 7],
                "pitch_m": 6.1,
            },
        ],
        "light": {"solar_time": 9.0},
    },
    "high-street": {
        "seed": 909,
        "length_m": 110.0,
        "frontage": "shops",
        "clutter": 0.9,
        "traffic": {
            "oncoming": 3,
            "ahead": 1,
            "pedestrians": 12,
            "crossing_pedestrians": 2,
            "cyclists": 2,
            "double_parked": 1,
        },
        "light": {"weather": "overcast", "wet": True},
    },
}
