"""What a person says about a street; everything else follows from the seeds."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from autowaze.simulator.presets import PRESETS
from autowaze.world.camera import StereoCamera
from autowaze.world.errors import AutowazeError

CarKind = Literal["city", "hatch", "sedan", "estate", "suv", "minivan", "van", "pickup", "sports", "truck"]
BayKind = Literal["parallel", "perpendicular", "angled"]
Side = Literal["left", "right"]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ParkingRow(_Part):
    """A row of bays along one side of a road."""

    road: int = Field(default=0, ge=0, description="which road of the plan; for a lot, which aisle")
    side: Side = "right"
    kind: BayKind = "parallel"
    count: int = Field(default=8, ge=1, le=200)
    start_m: float = Field(default=0.0, ge=0.0, description="from the first place where parking is allowed")
    driveways_after: tuple[int, ...] = Field(default=(), description="bays that a driveway follows, counted from 1")
    pitch_m: float | None = Field(default=None, gt=2.0, le=9.0, description="distance from bay to bay along the kerb")


class Parking(_Part):
    """How people park."""

    occupancy: Share = 0.75
    sloppiness: float = Field(
        default=1.0, ge=0.0, le=3.0, description="scales the usual offset and angle; 0 parks perfectly"
    )
    kinds: tuple[CarKind, ...] = (
        "city",
        "hatch",
        "sedan",
        "estate",
        "suv",
        "minivan",
        "van",
        "pickup",
        "sports",
        "truck",
    )
    vacant: tuple[str, ...] = Field(default=(), description="spots kept free whatever the occupancy")
    drive: int | None = Field(
        default=None, ge=0, description="the cars of this drive are parked; unless given, of the drive itself"
    )
    changed: Share = Field(
        default=0.0, description="share of the spots that are as the drive itself has them though `drive` is given"
    )


class Traffic(_Part):
    """What moves."""

    oncoming: int = Field(default=1, ge=0, le=20)
    ahead: int = Field(default=0, ge=0, le=5, description="cars in the ego lane in front of the ego vehicle")
    crossing: int = Field(default=0, ge=0, le=10, description="cars on the cross streets")
    pedestrians: int = Field(default=4, ge=0, le=40)
    crossing_pedestrians: int = Field(default=1, ge=0, le=10)
    cyclists: int = Field(default=1, ge=0, le=10)
    double_parked: int = Field(default=0, ge=0, le=3)
    leaving: int = Field(default=0, ge=0, le=3, description="parked cars that pull out during the drive")
    arriving: int = Field(default=0, ge=0, le=3, description="cars that park during the drive")


class Light(_Part):
    """Sun and weather."""

    date: str = Field(default="2024-06-12", pattern=r"^\d{4}-\d{2}-\d{2}$")
    solar_time: float = Field(default=14.0, ge=0.0, lt=24.0, description="hours by the sun")
    weather: Literal["clear", "hazy", "overcast", "dusk"] = "clear"
    wet: bool = False


class Effects(_Part):
    """What lens and sensor add; zero or false switches one off."""

    exposure: float = Field(default=1.0, gt=0.0, le=8.0)
    vignetting: Share = 0.25
    motion_blur_ms: float = Field(default=2.0, ge=0.0, le=40.0)
    noise: float = Field(default=1.0, ge=0.0, le=10.0, description="scales the noise of a clean industrial camera")
    rectification_residual_px: float = Field(default=0.1, ge=0.0, le=2.0)
    lens_dirt: Share = 0.0
    grey: bool = False


class Rig(_Part):
    """Stereo rig: a known one, or free with `name = "free"` and all numbers given."""

    name: Literal["kitti", "zed2i-720", "zed2i-540", "free"] = "kitti"
    fx: float | None = Field(default=None, gt=0)
    cx: float | None = None
    cy: float | None = None
    baseline_m: float | None = Field(default=None, gt=0)
    width: int | None = Field(default=None, ge=64, le=4096)
    height: int | None = Field(default=None, ge=48, le=4096)
    mount_height_m: float = Field(default=1.65, gt=0.3, le=4.0)
    pitch_deg: float = Field(default=0.0, ge=-20.0, le=20.0, description="positive looks down")

    @model_validator(mode="after")
    def _complete(self) -> Rig:
        numbers = {"fx": self.fx, "baseline_m": self.baseline_m, "width": self.width, "height": self.height}
        given = [name for name, value in numbers.items() if value is not None]
        if self.name == "free" and len(given) < len(numbers):
            raise ValueError(f"a free rig needs {', '.join(sorted(set(numbers) - set(given)))}")
        if self.name != "free" and given:
            raise ValueError(f'{", ".join(given)} can only be given with name = "free"')
        return self

    @property
    def camera(self) -> StereoCamera:
        """Calibration of the rig."""
        if self.name != "free":
            return _RIGS[self.name]
        assert self.fx and self.baseline_m and self.width and self.height  # held by the validator
        cx = (self.width - 1) / 2 if self.cx is None else self.cx
        cy = (self.height - 1) / 2 if self.cy is None else self.cy
        return StereoCamera(self.fx, self.fx, cx, cy, self.baseline_m, self.width, self.height)


_RIGS = {
    "kitti": StereoCamera(
        721.5377, 721.5377, 609.5593, 172.854, 0.54, 1242, 375
    ),  # Geiger et al. 2013, cameras 0 and 1
    # ZED 2i with the 2.1 mm lens: 0.12 m baseline, about 101 degrees across at 1280 x 720 (Stereolabs' data sheet)
    "zed2i-720": StereoCamera(528.0, 528.0, 639.5, 359.5, 0.12, 1280, 720),
    "zed2i-540": StereoCamera(396.0, 396.0, 479.5, 269.5, 0.12, 960, 540),
}


class Ego(_Part):
    """How the ego vehicle drives."""

    speed_kmh: float = Field(default=22.0, gt=1.0, le=90.0)
    frames: int | None = Field(default=None, ge=1, le=100_000, description="stop after so many frames")
    fps: float = Field(default=10.0, gt=0.1, le=60.0)
    start_m: float = Field(default=0.0, ge=0.0, description="skip the beginning of the route")
    left_m: float = Field(default=0.0, ge=-3.0, le=6.0, description="so far to the left of where it would drive")
    opposite: bool = Field(default=False, description="drive the route from its end, in the other lane")
    start_time: float = Field(default=1_718_200_000.0, description="seconds since the epoch")
    gnss: bool = True


class StreetDescription(_Part):
    """A street, who parks and drives there, the light, and the camera that drives through.

    `seed` makes the street (buildings, trees, wear, and the plan where none is given), `drive` what changes from
    one drive to the next: which spots are taken, by what cars, traffic, noise.
    """

    name: str = Field(default="street", min_length=1, max_length=80)
    seed: int = Field(default=0, ge=0)
    drive: int = Field(default=0, ge=0)
    layout: Literal["straight", "curved", "block", "lot"] = "straight"
    length_m: float = Field(default=90.0, ge=40.0, le=400.0, description="between the crossings; a block's long side")
    depth_m: float = Field(default=60.0, ge=40.0, le=300.0, description="a block's short side")
    turn_deg: float = Field(
        default=25.0, ge=-90.0, le=90.0, description="how far a curved street turns, positive to the left"
    )
    heading_deg: float = Field(default=35.0, ge=0.0, lt=360.0, description="compass heading of the street")
    frontage: Literal["terraces", "shops", "houses", "mixed"] = "mixed"
    trees: Share = 0.5
    clutter: Share = 0.5
    latitude: float = Field(default=43.0845, gt=-89.0, lt=89.0)
    longitude: float = Field(default=-77.6749, ge=-180.0, le=180.0)
    altitude_m: float = 150.0
    rows: tuple[ParkingRow, ...] = Field(default=(), description="empty: laid out by the seed")
    parking: Parking = Parking()
    traffic: Traffic = Traffic()
    light: Light = Light()
    effects: Effects = Effects()
    rig: Rig = Rig()
    ego: Ego = Ego()


def load_description(street: str | Path, **changes: Any) -> StreetDescription:
    """The street of a preset's name or a TOML file, with some of its top-level members replaced.

    `changes` may also carry nested members as dictionaries: `load_description("town-a", light={"weather": "dusk"})`
    replaces only what is named.

    Raises:
        AutowazeError: no such preset or file, or a value that makes no sense; the message names it.
    """
    source = str(street)
    if source in PRESETS:
        document: dict[str, Any] = {"name": source, **PRESETS[source]}
    elif source.endswith(".toml"):
        document = _read_toml(Path(source))
    else:
        raise AutowazeError(f"{source}: no such street; give a .toml file or one of {', '.join(PRESETS)}")
    try:
        return StreetDescription.model_validate(_merged(document, changes))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "street"
        raise AutowazeError(f"{source}: {where}: {first['msg']}") from error


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return {"name": path.stem, **tomllib.loads(path.read_text(encoding="utf-8"))}
    except OSError as error:
        raise AutowazeError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise AutowazeError(f"{path}: not TOML: {error}") from error


def _merged(document: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    out = dict(document)
    for key, value in changes.items():
        if isinstance(value, dict) and isinstance(out.get(key), dict):
            out[key] = _merged(out[key], value)
        elif value is not None:
            out[key] = value
    return out
