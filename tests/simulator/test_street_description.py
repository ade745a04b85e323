from pathlib import Path

import pytest

from autowaze.simulator import PRESETS, load_description
from autowaze.world.errors import AutowazeError


def write(folder: Path, text: str) -> Path:
    path = folder / "elm.toml"
    path.write_text(text)
    return path


def test_a_street_is_named_after_its_file(tmp_path: Path) -> None:
    street = load_description(write(tmp_path, 'seed = 5\nlayout = "block"\n[light]\nweather = "dusk"\n'))
    assert (street.name, street.seed, street.layout, street.light.weather) == ("elm", 5, "block", "dusk")


def test_changes_reach_into_parts_and_leave_the_rest() -> None:
    street = load_description("gold", drive=3, light={"weather": "overcast"})
    assert street.drive == 3
    assert street.light.weather == "overcast"
    assert street.light.solar_time == PRESETS["gold"]["light"]["solar_time"]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("seed = ", "not TOML"),
        ("[parking]\noccupancy = 1.4", "parking.occupancy"),
        ('[parking]\nkinds = ["tank"]', "parking.kinds"),
        ("lenght_m = 80", "lenght_m"),
        ('[rig]\nname = "free"\nfx = 700', "baseline_m"),
    ],
)
def test_what_makes_no_sense_is_named_in_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(AutowazeError, match=complaint) as caught:
        load_description(write(tmp_path, text))
    assert "elm.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_street_lists_the_known() -> None:
    with pytest.raises(AutowazeError, match="town-a, town-b, gold"):
        load_description("towm-a")


@pytest.mark.parametrize(("rig", "baseline_m", "width"), [("kitti", 0.54, 1242), ("zed2i-720", 0.12, 1280)])
def test_known_rigs(rig: str, baseline_m: float, width: int) -> None:
    camera = load_description("town-a", rig={"name": rig}).rig.camera
    assert (camera.baseline_m, camera.width) == (baseline_m, width)
