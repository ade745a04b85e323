"""Pictures of the live map, taken without a test driver."""

import cv2
import numpy as np
import pytest
from block import drive_by

from autowaze.cli.screenshot import take_screenshot
from autowaze.world.errors import AutowazeError

FREE = (31, 191, 131)  # in dark colours


def test_a_picture_shows_the_map_as_it_is_drawn(serve, tmp_path):
    site = serve()
    drive_by(site, [0, 2, 4], 1)
    take_screenshot(site.url, tmp_path / "pictures" / "map.png", (900, 600), dark=True)
    image = cv2.imread(str(tmp_path / "pictures" / "map.png"))[:, :, ::-1]
    assert image.shape == (600, 900, 3)
    street = image[60:520, 380:]
    assert street.mean() < 80
    assert (np.abs(street.astype(int) - FREE).max(axis=2) < 25).mean() > 0.001


def test_a_page_that_is_not_there_is_one_clear_error(tmp_path):
    with pytest.raises(AutowazeError, match=r"127\.0\.0\.1:9.*cannot load"):
        take_screenshot("http://127.0.0.1:9/", tmp_path / "nothing.png")
    assert not (tmp_path / "nothing.png").exists()
