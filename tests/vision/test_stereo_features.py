from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from autowaze.vehicle.vision.extractor import FeatureExtractor
from autowaze.vehicle.vision.orb import Keypoints, OrbDetector, level_quota, sampling_pattern
from autowaze.vehicle.vision.pyramid import PyramidLayout
from autowaze.vehicle.vision.settings import VisionSettings
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.frame import Image, StereoFrame

CAMERA = StereoCamera(fx=400.0, fy=400.0, cx=320.0, cy=120.0, baseline_m=0.5, width=640, height=240)
SETTINGS = VisionSettings(n_features=800)


def _texture(width: int = 900, height: int = 240, seed: int = 1) -> Image:
    """Blobs of many sizes."""
    rng = np.random.default_rng(seed)
    total = np.zeros((height, width), np.float32)
    for sigma in (1.5, 3.0, 6.0, 12.0):
        layer = cv2.GaussianBlur(rng.normal(0, 1, (height, width)).astype(np.float32), None, sigma)
        total += layer / layer.std()
    return np.clip(128 + 30 * total, 0, 255).astype(np.uint8)


def _wall(disparity_px: float) -> StereoFrame:
    """A textured wall that fills the view at one disparity."""
    return _surface(np.full(240, disparity_px))


def _surface(disparity_px: NDArray[np.float64]) -> StereoFrame:
    """A textured surface with one disparity in each row (240,)."""
    texture = _texture()
    phase = np.exp(2j * np.pi * disparity_px[:, None] * np.fft.rfftfreq(900))  # exact, which interpolation would not be
    right = np.rint(np.clip(np.fft.irfft(np.fft.rfft(texture, axis=1) * phase, n=900, axis=1), 0, 255))
    return StereoFrame(0, 0.0, texture[:, 100:740].copy(), right[:, 100:740].astype(np.uint8))


@pytest.fixture(scope="module")
def extractor() -> FeatureExtractor:
    return FeatureExtractor(CAMERA, SETTINGS)


@pytest.mark.parametrize("disparity_px", [8.0, 20.25, 33.5, 12.75])
def test_a_wall_has_one_depth(extractor: FeatureExtractor, disparity_px: float) -> None:
    features = extractor.extract(_wall(disparity_px))
    matched = features[features.has_depth]
    assert len(matched) > 0.85 * len(features)
    measured = matched.uv[:, 0] - matched.u_right
    assert np.median(measured) == pytest.approx(disparity_px, abs=0.02)  # a parabola of costs leans by a tenth
    assert np.percentile(np.abs(measured - disparity_px), 90) < 0.2
    np.testing.assert_allclose(matched.depth, CAMERA.bf / measured, rtol=1e-5)
    np.testing.assert_allclose(CAMERA.project(matched.position_cam)[:, :2], matched.uv, atol=1e-2)


def test_the_road_is_no_wall(extractor: FeatureExtractor) -> None:
    """Its disparity changes by 0.3 from row to row, by 3 over a patch."""
    features = extractor.extract(_surface(18.0 + 0.3 * np.arange(240)))
    matched = features[features.has_depth & (features.uv[:, 1] > 40) & (features.octave < 4)]
    error = matched.uv[:, 0] - matched.u_right - (18.0 + 0.3 * matched.uv[:, 1])
    assert len(matched) > 250
    assert np.median(error) == pytest.approx(0.0, abs=0.03)
    assert np.percentile(np.abs(error), 75) < 0.18  # 0.28 where patches are taken for upright


def test_a_slightly_darker_right_camera_sees_the_same_depth(extractor: FeatureExtractor) -> None:
    frame = _wall(20.25)
    darker = np.clip(0.97 * frame.right - 2.0, 0, 255).astype(np.uint8)
    matched = extractor.extract(StereoFrame(0, 0.0, frame.left, darker))
    measured = (matched.uv[:, 0] - matched.u_right)[matched.has_depth]
    assert len(measured) > 0.8 * len(matched)
    assert np.median(measured) == pytest.approx(20.25, abs=0.05)


def test_a_repetitive_fence_has_no_depth(extractor: FeatureExtractor) -> None:
    columns = np.arange(640)
    fence = np.where((columns // 8) % 2, 200, 60).astype(np.uint8)[None].repeat(240, axis=0)
    fence[np.arange(240) // 20 % 2 == 1] = 128
    features = extractor.extract(StereoFrame(0, 0.0, fence, fence))
    assert len(features) > 50
    assert features.has_depth.mean() < 0.05


def test_same_images_same_bits(extractor: FeatureExtractor) -> None:
    frame = _wall(12.0)
    assert _bytes(extractor.extract(frame)) == _bytes(FeatureExtractor(CAMERA, SETTINGS).extract(frame))


def test_a_blank_image_has_no_features(extractor: FeatureExtractor) -> None:
    blank = np.full((240, 640), 90, np.uint8)
    assert len(extractor.extract(StereoFrame(0, 0.0, blank, blank))) == 0


def test_features_cover_a_dim_half_of_the_image(extractor: FeatureExtractor) -> None:
    frame = _wall(10.0)
    dim = frame.left.copy()
    dim[:, :320] = 40 + dim[:, :320] // 6
    features = extractor.extract(StereoFrame(0, 0.0, dim, dim))
    assert np.count_nonzero(features.uv[:, 0] < 320) > 0.3 * len(features)


def test_a_feature_keeps_its_place_and_descriptor_when_the_image_is_turned() -> None:
    layout = PyramidLayout.of(400, 400, 8, 1.2)
    image = _texture(400, 400)
    detector = OrbDetector(500, layout, 7)
    upright, turned = _keypoints(detector, image), _keypoints(detector, np.rot90(image).copy())
    back = np.stack([399 - turned.uv[:, 1], turned.uv[:, 0]], axis=1)  # where rot90 took the pixels from
    offset = np.linalg.norm(back[None] - upright.uv[:, None], axis=2)
    offset[upright.octave[:, None] != turned.octave[None]] = np.inf
    same = np.flatnonzero(offset.min(axis=1) < 0.5)
    assert len(same) > 0.7 * len(upright)
    bits = np.unpackbits(upright.descriptor[same] ^ turned.descriptor[offset.argmin(axis=1)[same]], axis=1).sum(axis=1)
    assert np.median(bits) < 30


def test_coarse_levels_are_not_shifted() -> None:
    """Multiplying level pixels by the scale would place a blob at level 7 more than a pixel off."""
    centre = np.array([200.0, 150.0])
    y, x = np.mgrid[:300, :400]
    blob = np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (2 * 9.0**2))
    image = (40 + 180 * blob).astype(np.uint8)
    found = _keypoints(OrbDetector(50, PyramidLayout.of(400, 300, 8, 1.2), 7), image)
    coarse = found[found.octave >= 5]
    assert len(coarse)
    assert np.linalg.norm(coarse.uv.mean(axis=0) - centre) < 1.0


def test_quota_sums_to_the_number_of_features() -> None:
    quota = level_quota(2000, PyramidLayout.of(1241, 376, 8, 1.2))
    assert quota.sum() == 2000
    assert (np.diff(quota) < 0).all()


def test_the_sampling_pattern_is_the_one_of_stored_maps() -> None:
    pattern = sampling_pattern()
    assert pattern.shape == (256, 2, 2)
    assert np.abs(pattern).max() <= 13
    assert np.rint(2.9 * pattern.sum()) == -339


def _keypoints(detector: OrbDetector, image: Image) -> Keypoints:
    with ThreadPoolExecutor(1) as helper:
        return detector.describe(detector.detect(image, helper))


def _bytes(features: CameraFeatures) -> bytes:
    return b"".join(np.ascontiguousarray(column).tobytes() for column in vars(features).values())
