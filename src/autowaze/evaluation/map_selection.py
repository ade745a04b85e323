"""The features of a map that are worth their bytes: those that localisation will find, wherever it looks from.

A map that keeps whatever was seen holds most of it in vain: near a shop window there are more corners than any pose
needs, elsewhere few. The survey's own path says from where the map will be looked at, so features are chosen to cover
the image as seen from each place of it (as Li, Snavely and Huttenlocher 2010 cover the views of a database, "Location
recognition using prioritized feature matching", with image regions in place of images): greedily by what each adds to
the sum of log(1 + matches to be expected) over places and regions, so that the tenth match of a region is worth less
than the first one elsewhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.projection import Predictions, predict
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import MapFeatures

FEATURES_PER_METRE = 60.0
"""Described features for each metre of street: 2.1 MB per km (docs/evaluation.md has errors by density)."""
_PLACE_M = 2.0
_COLUMNS, _ROWS = 8, 3  # regions of the image
_ROUNDS = 100


def worth_keeping(
    features: MapFeatures,
    T_map_cam: NDArray[np.float64],
    camera: StereoCamera,
    per_metre: float = FEATURES_PER_METRE,
) -> NDArray[np.bool_]:
    """Mask (N,) of the features to keep; those without descriptor cost little and all stay.

    Args:
        features: of the surveyed map.
        T_map_cam: (F, 4, 4) poses of the survey, of one drive or of several, in the order driven.
        camera: that saw them.
        per_metre: described features for each metre of the path; a street driven twice counts twice.
    """
    keep = ~features.described
    rows = np.flatnonzero(features.described)
    places = _places(T_map_cam)
    room = round(per_metre * max(len(places), 1) * _PLACE_M)
    if len(rows) <= room:
        return np.ones(len(features), np.bool_)
    feature, region = _sightings(features[rows], places, camera)
    keep[rows[_cover(feature, region, _hit_rate(features[rows], feature, len(T_map_cam) / len(places)), room)]] = True
    return keep


def _places(T_map_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (P, 4, 4) of the path, one for every two metres."""
    steps = np.linalg.norm(np.diff(T_map_cam[:, :3, 3], axis=0), axis=1)
    driven = np.concatenate([[0.0], np.cumsum(steps)])
    return T_map_cam[np.unique(np.searchsorted(driven, np.arange(0.0, driven[-1] + 1e-9, _PLACE_M)))]


def _sightings(
    features: MapFeatures, places: NDArray[np.float64], camera: StereoCamera
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of features (S,) and the regions (S,) of places in which they are predicted visible."""
    landmarks, level_scale = Landmarks(len(features)), SlamSettings().level_scale
    landmarks.add_stored(features)
    every = np.arange(len(features))
    found = [predict(landmarks, every, T, camera, level_scale) for T in places]
    regions = [_region(p, camera) + _COLUMNS * _ROWS * number for number, p in enumerate(found)]
    return np.concatenate([p.row for p in found]), np.concatenate(regions)


def _region(predictions: Predictions, camera: StereoCamera) -> NDArray[np.int64]:
    share = predictions.pixel[:, :2] / [camera.width, camera.height]
    column, row = (share * [_COLUMNS, _ROWS]).astype(np.int64).T
    return np.asarray(np.minimum(row, _ROWS - 1) * _COLUMNS + np.minimum(column, _COLUMNS - 1))


def _hit_rate(features: MapFeatures, feature: NDArray[np.int64], frames_per_place: float) -> NDArray[np.float64]:
    """Share (N,) of the frames that should have seen a feature in which it was matched."""
    predicted = np.bincount(feature, minlength=len(features)) * frames_per_place
    return np.asarray(np.clip(features.observations / np.maximum(predicted, 1.0), 0.0, 1.0))


def _cover(
    feature: NDArray[np.int64], region: NDArray[np.int64], hit_rate: NDArray[np.float64], room: int
) -> NDArray[np.int64]:
    """Rows of the chosen features, in rounds: what each would add given those of the rounds before."""
    expected = np.zeros(int(region.max(initial=-1)) + 1)
    left = np.ones(len(hit_rate), np.bool_)
    chosen: list[NDArray[np.int64]] = []
    for size in np.diff(np.linspace(0, room, _ROUNDS + 1).astype(np.int64)).tolist():
        worth = np.bincount(feature, weights=1.0 / (1.0 + expected[region]), minlength=len(left)) * hit_rate
        best = np.argsort(np.where(left, -worth, np.inf), kind="stable")[:size]
        left[best] = False
        chosen.append(best)
        new = np.isin(feature, best)
        expected += np.bincount(region[new], weights=hit_rate[feature[new]], minlength=len(expected))
    return np.concatenate(chosen)
