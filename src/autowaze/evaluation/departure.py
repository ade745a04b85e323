"""Cars that left: does the diff report their features removed?

A second drive through an unchanged street is made to miss one labelled vehicle, by dropping the camera features
inside its mask; everything else of the drive stays as it is. Then all features that the stored map has of that
vehicle are gone as far as the car can tell, and the diffs should say so, and say it of no other feature.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.drive import run_drive
from autowaze.traces import Trace
from autowaze.traces.kitti_labels import ObjectLabels
from autowaze.vehicle.node import VehicleNode
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.vehicle.vision.extractor import FeatureExtractor
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.features import CameraFeatures
from autowaze.world.frame import Image, StereoFrame
from autowaze.world.instances import Detections
from autowaze.world.labels import is_vehicle
from autowaze.world.pose import Pose, inverse, transform

_BOX_MARGIN_M = 0.1  # labelled boxes end short of bumpers, but a wider rim takes in those of the car behind
_MIN_IOU = 0.5
_MASK_RIM_PX = 5
"""Corners of the roof lie on the rim of a mask, which is good to a cell of the network's output: 4 pixels."""


@dataclass(frozen=True)
class ParkedVehicle:
    """A labelled vehicle that stands still: bottom centre in the world frame (camera axes), size, KITTI's yaw."""

    track_id: int
    centre_world: NDArray[np.float64]
    length_m: float
    width_m: float
    yaw: float

    @classmethod
    def from_file(cls, path: Path) -> list[ParkedVehicle]:
        """Vehicles of a `vehicles.json`; the outline seen by LiDAR, where there is one, is nearer the truth."""
        vehicles = []
        for v in json.loads(path.read_text(encoding="utf-8"))["vehicles"]:
            outline = v.get("lidar_extent") or {}
            x, z = outline.get("center_xz") or (v["center_xyz"][0], v["center_xyz"][2])
            length, width = (max(v[k], outline.get(k) or 0.0) for k in ("length", "width"))
            centre = np.array([x, v["center_xyz"][1], z])
            vehicles.append(cls(v["track_id"], centre, length, width, v["yaw"]))
        return vehicles

    def holds(self, points_world: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mask (N,) of the points (N, 3) over its footprint."""
        x, z = (points_world - self.centre_world)[:, [0, 2]].T
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        along, across = c * x - s * z, s * x + c * z
        return np.asarray(
            (np.abs(along) <= self.length_m / 2 + _BOX_MARGIN_M) & (np.abs(across) <= self.width_m / 2 + _BOX_MARGIN_M)
        )


@dataclass(frozen=True)
class Departure:
    """What the diffs said when one vehicle was gone.

    Attributes:
        track_id: of the vehicle.
        features: features that the stored map has of it.
        removed: those of them reported removed.
        others_removed: features of everything else reported removed, of `others` predicted visible.
    """

    track_id: int
    features: int
    removed: int
    others_removed: int
    others: int

    @property
    def removed_fraction(self) -> float:
        """Share of its features reported removed."""
        return self.removed / max(self.features, 1)


def depart(
    vehicle: ParkedVehicle,
    trace: Trace,
    stored_map: FeatureMap,
    labels: ObjectLabels,
    segmenter: Segmenter,
    T_map_world: Pose,
) -> Departure:
    """Drive the trace in the stored map without seeing one vehicle."""
    extractor = BlindExtractor(FeatureExtractor(trace.camera), labels[labels.track_id == vehicle.track_id], segmenter)
    node = VehicleNode(
        trace.camera,
        segmenter,
        stored_map=stored_map,
        start=starting_point(trace, None, Start.GNSS),
        session=2,
        extractor=extractor,
    )
    looked_for: list[NDArray[np.uint64]] = []
    record = run_drive(trace, node, lambda message: looked_for.append(node.window.looked_for.map_id))
    removed = np.concatenate([diff.removed for diff in record.diffs])
    own = features_of(vehicle, stored_map, T_map_world).id
    others = np.setdiff1d(np.concatenate(looked_for), own)
    return Departure(
        vehicle.track_id,
        features=len(own),
        removed=int(np.isin(own, removed).sum()),
        others_removed=len(np.setdiff1d(removed, own)),
        others=len(others),
    )


def features_of(vehicle: ParkedVehicle, stored_map: FeatureMap, T_map_world: Pose) -> MapFeatures:
    """The vehicle-labelled features of a stored map that lie in the vehicle's box."""
    features = stored_map.features
    inside = vehicle.holds(transform(inverse(T_map_world), features.position))
    return features[inside & is_vehicle(features.label)]


class BlindExtractor:
    """Drops the features inside the mask of one labelled object, and those on its rim."""

    def __init__(self, inner: FeatureExtractor, labels: ObjectLabels, segmenter: Segmenter) -> None:
        self._inner = inner
        self._labels = labels
        self._segmenter = segmenter

    def extract(self, frame: StereoFrame) -> CameraFeatures:
        """Features of the frame outside the object's mask."""
        features = self._inner.extract(frame)
        row = np.flatnonzero(self._labels.frame == frame.index)
        if not len(row):
            return features
        mask = mask_of(self._labels.box[row[0]], self._segmenter.segment(frame.left), frame.left.shape[:2])
        rim = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _MASK_RIM_PX + 1, 2 * _MASK_RIM_PX + 1))
        mask = cv2.dilate(mask.astype(np.uint8), rim) > 0
        u, v = np.rint(features.uv).astype(np.int64).T
        return features[~mask[np.clip(v, 0, mask.shape[0] - 1), np.clip(u, 0, mask.shape[1] - 1)]]


def mask_of(box: NDArray[np.float64], detections: Detections, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mask (H, W) of the detection that a labelled 2D box belongs to; the box itself where none fits."""
    overlap = _iou(box, detections.box.astype(np.float64))
    if len(overlap) and overlap.max() >= _MIN_IOU:
        return np.asarray(detections.mask[overlap.argmax()])
    mask = np.zeros(shape, np.bool_)
    left, top, right, bottom = np.rint(box).astype(int).tolist()
    mask[max(top, 0) : bottom, max(left, 0) : right] = True
    return mask


class RememberingSegmenter:
    """Segments every image once, however often a drive is repeated."""

    def __init__(self, inner: Segmenter) -> None:
        self.name = inner.name
        self._segment = cache(lambda key: inner.segment(self._images[key]))
        self._images: dict[bytes, Image] = {}

    def segment(self, image: Image) -> Detections:
        """As the inner one."""
        key = image[::7, ::5].tobytes()
        self._images[key] = image
        return self._segment(key)


def _iou(box: NDArray[np.float64], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    low, high = np.maximum(box[:2], boxes[:, :2]), np.minimum(box[2:], boxes[:, 2:])
    shared = np.prod(np.maximum(high - low, 0.0), axis=1)
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) + np.prod(box[2:] - box[:2])
    return np.asarray(shared / np.maximum(areas - shared, 1e-9))
