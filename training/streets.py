"""Descriptions of random streets, unlike any preset."""

from __future__ import annotations

import numpy as np

from autowaze.simulator.description import StreetDescription

_FIRST_SEED = 10_000_000  # presets and evaluation use small seeds: no training street is one of theirs


def random_description(number: int, rng: np.random.Generator) -> StreetDescription:
    """The street of a number, unlike any preset."""
    layout = str(rng.choice(["straight", "straight", "curved", "curved", "block", "lot"]))
    tall = rng.random() < 0.15
    width, height = (960, 540) if tall else (1242, 375)
    fx = float(np.exp(rng.uniform(np.log(430), np.log(950))))
    return StreetDescription.model_validate(
        {
            "seed": _FIRST_SEED + number,
            "layout": layout,
            "length_m": float(rng.uniform(60, 110)),
            "turn_deg": float(rng.uniform(-40, 40)),
            "heading_deg": float(rng.uniform(0, 359)),
            "frontage": str(rng.choice(["terraces", "shops", "houses", "mixed"])),
            "trees": float(rng.uniform(0, 1)),
            "clutter": float(rng.uniform(0, 1)),
            "rows": [] if layout in ("block", "lot") or rng.random() < 0.4 else _random_rows(rng),
            "parking": {"occupancy": 0.0},
            "light": {
                "date": str(rng.choice(["2024-06-12", "2024-03-20", "2024-10-20", "2024-12-01"])),
                "solar_time": float(rng.uniform(7.0, 18.0)),
                "weather": str(rng.choice(["clear", "clear", "clear", "hazy", "overcast", "dusk"])),
                "wet": bool(rng.random() < 0.15),
            },
            "effects": {
                "vignetting": float(rng.uniform(0, 0.5)),
                "lens_dirt": float(rng.choice([0.0, 0.0, rng.uniform(0, 0.6)])),
            },
            "rig": {"name": "free", "fx": fx, "baseline_m": 0.5, "width": width, "height": height},
        }
    )


def _random_rows(rng: np.random.Generator) -> list[dict[str, object]]:
    rows = []
    for side in ("left", "right"):
        kind = str(rng.choice(["parallel", "parallel", "perpendicular", "angled"]))
        pitch_m = {"parallel": rng.uniform(5.45, 6.3), "perpendicular": rng.uniform(2.3, 2.9), "angled": 3.0}[kind]
        room = 34.0  # metres that even the shortest of these streets has
        rows.append({"side": side, "kind": kind, "count": int(room / pitch_m), "pitch_m": float(pitch_m)})
    return rows
