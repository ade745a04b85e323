"""All surfaces of a street, painted from its seed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from autowaze.simulator.scene import Surface
from autowaze.simulator.surfaces import foliage, ground, marks, masonry, openings
from autowaze.simulator.surfaces.finish import MATTE
from autowaze.simulator.surfaces.signs import paint_signs

_WINDOW_GLOW = 1.1
_LIT_SHARE = 0.45


@lru_cache(maxsize=2)
def street_surfaces(seed: int, night: bool, autumn: bool) -> dict[str, Surface]:
    """Surfaces by name; painting takes a few seconds, so the last two streets are kept."""

    def rng(number: int) -> np.random.Generator:
        return np.random.default_rng([seed, 2, number])

    lit = _LIT_SHARE if night else 0.0
    lamp = np.full((8, 8, 4), 235, np.uint8)
    lamp[..., 3] = MATTE
    dark = Surface(ground.paint_contact_shadow(), decal=True)
    return {
        "asphalt": Surface(ground.paint_asphalt(rng(0)), wettable=True, underfoot=True),
        "paving": Surface(ground.paint_paving(rng(1)), wettable=True, underfoot=True),
        "kerb": Surface(ground.paint_kerb(rng(2)), wettable=True, underfoot=True),
        "grass": Surface(ground.paint_grass(rng(3)), underfoot=True),
        "marking": Surface(ground.paint_marking(rng(4)), decal=True, wettable=True),
        "blemishes": Surface(ground.paint_blemishes(rng(5)), decal=True, wettable=True),
        "contact-shadow": dark,
        **{
            f"wall-{kind}": Surface(masonry.paint_wall(kind, rng(10 + i)))
            for i, kind in enumerate(masonry.WALL_COLOURS)
        },
        "roof": Surface(masonry.paint_roof(rng(20))),
        "plain": Surface(masonry.paint_plain(rng(21))),
        "metal": Surface(masonry.paint_plain(rng(22), tone=200.0), gloss=0.25),
        "bark": Surface(masonry.paint_bark(rng(23))),
        "leaves": Surface(foliage.paint_leaves(rng(24), 0.75 if autumn else 0.1), cutout=True),
        "hedge": Surface(foliage.paint_hedge(rng(25))),
        "windows": Surface(openings.paint_windows(rng(26), lit)),
        "shops": Surface(openings.paint_shops(rng(27), 2 * lit), glow=0.35 if night else 0.0),
        "awning": Surface(openings.paint_awning(rng(28))),
        "garage": Surface(openings.paint_garage(rng(29))),
        "signs": Surface(paint_signs()),
        "wall-marks": Surface(marks.paint_marks(rng(30)), decal=True),
        "lamp": Surface(lamp, glow=2.5 if night else 0.0),
    }
