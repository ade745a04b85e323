"""Which drives the experiments are made of: streets, seeds, light, who is parked and who is about."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from autowaze.simulator import StreetDescription, load_description

_FIRST_DRIVE, _DRIVES_PER_SEED = 5000, 1000
"""Number of the first drive of a series; the demonstration and the tests use lower ones."""
_EGO: dict[str, Any] = {"fps": 6.0, "speed_kmh": 24.0}
"""A frame every metre is enough to localise by; rendering costs most of an experiment's time."""
_SURVEY_TIME = 1_718_106_000.0
_NOTHING_CHANGED = 900
"""Number, within a seed, of the drive past the very cars of the survey."""
_BETWEEN_DRIVES_S = 7200.0
"""Two mean dwell times: what was parked in one drive says little of the next."""

_TOWN_STREETS = {"town-a": 25, "town-b": 25}
_REAL_STREETS = {"gold": 6, "langslow": 5, "stewart": 6, "lot-b": 3}
"""Drives on each; the thesis drove three streets and, a few times, a car park (sec. 4.1.2)."""
_LIGHTS: tuple[dict[str, Any], ...] = (
    {"weather": "clear", "solar_time": 14.0},
    {"weather": "overcast", "solar_time": 12.0},
    {"weather": "hazy", "solar_time": 10.0},
    {"weather": "clear", "solar_time": 16.5},
    {"weather": "clear", "solar_time": 9.5},
    {"weather": "dusk", "solar_time": 20.0},
)
_SENSOR: dict[str, Any] = {
    "noise": 1.5,
    "motion_blur_ms": 4.0,
    "rectification_residual_px": 0.15,
    "lens_dirt": 0.1,
}
_DENSE_TRAFFIC: dict[str, Any] = {
    "oncoming": 3,
    "ahead": 1,
    "crossing": 1,
    "pedestrians": 8,
    "cyclists": 2,
    "double_parked": 1,
}
_DENSE_EVERY = 3


@dataclass(frozen=True)
class PlannedDrive:
    """One drive.

    Attributes:
        name: of its folder, unique among all experiments.
        number: within its series; 0 is the survey that makes the base map and is not judged.
    """

    name: str
    number: int
    description: StreetDescription


@dataclass(frozen=True)
class Series:
    """Drives through one street one after the other; each leaves its map to the next.

    Attributes:
        street: its name.
        drives: the survey, then those that are judged.
        unchanged: another drive past the very cars of the survey, with its map alone, to see what a street costs in
            which nothing has changed; it is not judged and leaves nothing behind.
    """

    street: str
    drives: tuple[PlannedDrive, ...]
    unchanged: PlannedDrive | None = None

    @property
    def to_drive(self) -> tuple[PlannedDrive, ...]:
        """All of them in the order in which they are driven."""
        again = () if self.unchanged is None else (self.unchanged,)
        return (*self.drives[:1], *again, *self.drives[1:])

    @property
    def judged(self) -> tuple[PlannedDrive, ...]:
        """All but the survey."""
        return self.drives[1:]


@dataclass(frozen=True)
class Experiment:
    """Series that are judged together."""

    name: str
    title: str
    series: tuple[Series, ...]

    @property
    def judged(self) -> tuple[PlannedDrive, ...]:
        """All drives but the surveys."""
        return tuple(drive for series in self.series for drive in series.judged)


def town_streets(seed: int = 0, drives: dict[str, int] | None = None) -> Experiment:
    """The thesis's simulated experiment: 50 drives over two streets of 15 spots, occupancy and cars drawn anew."""
    return Experiment(
        "town",
        "Town streets, KITTI-like rig",
        tuple(_series(street, seed, count, 3.0 / 15.0, {}) for street, count in (drives or _TOWN_STREETS).items()),
    )


def real_world_like_streets(seed: int = 0, drives: dict[str, int] | None = None) -> Experiment:
    """The thesis's real experiment in the simulator's likeness: ZED 2i-like rig, noise, other light, some traffic."""
    drives = drives or _REAL_STREETS
    return Experiment(
        "real-world-like",
        "Real-world-like streets, ZED 2i-like rig",
        tuple(_series(street, seed, count, 0.3, {"effects": _SENSOR}, varied=True) for street, count in drives.items()),
    )


def quick_experiments(seed: int = 0) -> tuple[Experiment, ...]:
    """A few drives of each, for every change to be measured by: as long to render on one core as on the other."""
    return town_streets(seed, {"town-a": 2, "town-b": 1}), real_world_like_streets(seed, {"gold": 1})


def full_experiments(seed: int = 0) -> tuple[Experiment, ...]:
    """All drives, and one through each street while nothing has changed."""
    every = town_streets(seed), real_world_like_streets(seed)
    return tuple(replace(one, series=tuple(map(_with_nothing_changed, one.series))) for one in every)


def _series(
    street: str, seed: int, count: int, least_occupancy: float, changes: dict[str, Any], varied: bool = False
) -> Series:
    """Drive n is the same whatever the number of drives."""
    drives, marked = [], f"-s{seed}" if seed else ""
    for number in range(count + 1):
        description = load_description(street, drive=_FIRST_DRIVE + seed * _DRIVES_PER_SEED + number)
        rng = np.random.default_rng([description.seed, description.drive, 77])
        own: dict[str, Any] = {"ego": _EGO | {"start_time": _SURVEY_TIME + number * _BETWEEN_DRIVES_S}, **changes}
        if number:
            own["parking"] = {"occupancy": float(rng.uniform(least_occupancy, 1.0))}
        if number and varied:
            own["light"] = _LIGHTS[number % len(_LIGHTS)]
            own["effects"] = changes["effects"] | {"exposure": float(rng.uniform(0.8, 1.25))}
            own["traffic"] = _DENSE_TRAFFIC if number % _DENSE_EVERY == 0 else {}
        drives.append(
            PlannedDrive(
                f"{street}{marked}-{number:02d}", number, load_description(street, drive=description.drive, **own)
            )
        )
    return Series(street, tuple(drives))


def _with_nothing_changed(series: Series) -> Series:
    """The series and the drive past the cars of its survey: a later hour and other noise; other light, if it varies."""
    survey = series.drives[0].description
    again = {
        "drive": survey.drive + _NOTHING_CHANGED,
        "ego": survey.ego.model_copy(update={"start_time": survey.ego.start_time + _BETWEEN_DRIVES_S}),
        "parking": survey.parking.model_copy(update={"drive": survey.drive}),
        "light": series.drives[1].description.light,
    }
    name = series.drives[0].name.removesuffix("00") + "unchanged"
    return replace(series, unchanged=PlannedDrive(name, _NOTHING_CHANGED, survey.model_copy(update=again)))
