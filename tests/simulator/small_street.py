"""A street small enough for tests."""

from autowaze.simulator import StreetDescription, load_description

SMALL_RIG = {"name": "free", "fx": 210.0, "baseline_m": 0.5, "width": 360, "height": 140}


def small_street(**changes: object) -> StreetDescription:
    parts = {
        "rig": SMALL_RIG,
        "ego": {"frames": 60},
        "effects": {"motion_blur_ms": 0.0, "rectification_residual_px": 0.0},
        "traffic": {"oncoming": 1, "leaving": 1, "pedestrians": 2, "cyclists": 1},
    }
    return load_description("town-a", **{**parts, **changes})
