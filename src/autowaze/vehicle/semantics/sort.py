"""SORT: simple online and realtime tracking (Bewley et al. 2016), and what a moving stereo camera adds to it.

The paper: a Kalman filter foretells each track's box, the Hungarian method assigns detections by IoU. A car that
drives past parked ones sees their boxes sweep through the image and hide each other. Where its pose and their depth
are known, the filter is told how the box of a standing object moves, detections at another depth are refused, and
a hidden object is waited for where it stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from autowaze.vehicle.semantics.billboard import billboards, project_billboards
from autowaze.vehicle.semantics.box_filter import BoxFilter, boxes_to_measurements, states_to_boxes
from autowaze.vehicle.semantics.classes import kinds
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections, Tracks
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import Pose


@dataclass(frozen=True, slots=True)
class SortSettings:
    """What can be set about tracking.

    Attributes:
        min_iou: least overlap of a detection with the foretold box (paper: IoU_min).
        min_hits: frames that a track must have been seen in before it is reported.
        max_age: frames without a detection that a track survives (paper: T_Lost = 1).
        max_age_in_map: the same for a track whose place in the map is known and in view.
        min_containment: least share of a detection that lies in the foretold box of a partly hidden object, when
            their depths agree.
        depth_tolerance_m, disparity_sigma_px: depths agree within the tolerance plus four standard deviations.
    """

    min_iou: float = 0.3
    min_hits: int = 1
    max_age: int = 1
    max_age_in_map: int = 30
    min_containment: float = 0.7
    depth_tolerance_m: float = 2.0
    disparity_sigma_px: float = 0.5


class Sort:
    """Gives detections ids that hold over frames; plain SORT without camera, poses and depths."""

    def __init__(self, camera: StereoCamera | None = None, settings: SortSettings = SortSettings()) -> None:
        self.camera = camera
        self.settings = settings
        self._filter = BoxFilter()
        self._id = np.zeros(0, np.int32)
        self._hits = np.zeros(0, np.int64)
        self._age = np.zeros(0, np.int64)
        self._votes = np.zeros((0, len(ClassLabel)))
        self._corners = np.zeros((0, 4, 3))
        self._next_id = 1
        self._T_map_cam: Pose | None = None

    def update(
        self,
        detections: Detections,
        T_map_cam: Pose | None = None,
        edge_depth: NDArray[np.floating] | None = None,
    ) -> Tracks:
        """Tracks of the next frame.

        Args:
            detections: instances of the frame.
            T_map_cam: pose of the frame or its prediction; None for plain SORT.
            edge_depth: (N, 2) depth in metres of each detection's surface at the left and at the right edge of its
                box (`association.edge_depths`); NaN where unknown.

        Returns:
            The detections that belong to a reported track, in their order, with the label most often seen.
        """
        measured = boxes_to_measurements(detections.box)
        depth = np.full((len(detections), 2), np.nan) if edge_depth is None else np.asarray(edge_depth, np.float64)
        track_depth = self._predict(T_map_cam)
        row_of_detection = self._match(detections, depth.mean(axis=1), track_depth)
        known = np.flatnonzero(row_of_detection >= 0)
        self._age += 1
        self._filter.correct(row_of_detection[known], measured[known])
        row_of_detection = self._start_tracks(row_of_detection, measured)
        self._age[row_of_detection] = 0
        self._hits[row_of_detection] += 1
        self._votes[row_of_detection, detections.label] += detections.confidence
        self._place(row_of_detection, detections, depth, T_map_cam)
        tracks = self._report(row_of_detection, detections)
        self._drop_lost()
        return tracks

    def _predict(self, T_map_cam: Pose | None) -> NDArray[np.float64]:
        """Move every track to the next frame; depths (T,) where the tracks should be seen, NaN if unknown."""
        shift = np.zeros((len(self._id), 4))
        depth = np.full(len(self._id), np.nan)
        if self.camera is not None and T_map_cam is not None and self._T_map_cam is not None:
            before, _ = project_billboards(self._corners, self.camera, self._T_map_cam)
            after, depth = project_billboards(self._corners, self.camera, T_map_cam)
            moved = boxes_to_measurements(after) - boxes_to_measurements(before)
            shift = np.where(np.isfinite(depth)[:, None], moved, 0.0)
        self._filter.predict(shift)
        self._T_map_cam = T_map_cam
        return depth

    def _match(
        self, detections: Detections, depth: NDArray[np.float64], track_depth: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """Row (D,) of the track that each detection continues, -1 for none."""
        s = self.settings
        boxes = states_to_boxes(self._filter.mean)
        iou, containment = _overlaps(np.asarray(detections.box, np.float64), boxes)
        difference = np.abs(depth[:, None] - track_depth[None, :])
        allowed = s.depth_tolerance_m + 4.0 * self._depth_sigma(np.fmin(depth[:, None], track_depth[None, :]))
        both_known = np.isfinite(difference)
        same_kind = kinds(detections.label)[:, None] == kinds(self._label())[None, :]
        possible = same_kind & ~(both_known & (difference > allowed))
        rows = np.full(len(detections), -1, np.int64)
        _assign(rows, np.where(possible & (iou >= s.min_iou), iou, 0.0))
        _assign(rows, np.where(possible & both_known & (containment >= s.min_containment), containment, 0.0))
        return rows

    def _depth_sigma(self, depth: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.camera is None:
            return np.zeros_like(depth)
        return np.asarray(depth**2 / self.camera.bf * self.settings.disparity_sigma_px)

    def _start_tracks(self, row_of_detection: NDArray[np.int64], measured: NDArray[np.float64]) -> NDArray[np.int64]:
        """Append a track per unmatched detection; returns the rows (D,), now complete."""
        new = np.flatnonzero(row_of_detection < 0)
        rows = row_of_detection.copy()
        rows[new] = len(self._id) + np.arange(len(new))
        self._filter.add(measured[new])
        self._id = np.concatenate([self._id, np.arange(self._next_id, self._next_id + len(new), dtype=np.int32)])
        self._next_id += len(new)
        self._hits = np.concatenate([self._hits, np.zeros(len(new), np.int64)])
        self._age = np.concatenate([self._age, np.zeros(len(new), np.int64)])
        self._votes = np.concatenate([self._votes, np.zeros((len(new), len(ClassLabel)))])
        self._corners = np.concatenate([self._corners, np.full((len(new), 4, 3), np.nan)])
        return rows

    def _place(
        self,
        rows: NDArray[np.int64],
        detections: Detections,
        depth: NDArray[np.float64],
        T_map_cam: Pose | None,
    ) -> None:
        """Remember where in the map the detected sides stand; without depth the old place no longer counts."""
        if self.camera is not None and T_map_cam is not None:
            self._corners[rows] = billboards(detections.box, depth, self.camera, T_map_cam)

    def _report(self, rows: NDArray[np.int64], detections: Detections) -> Tracks:
        d = detections[self._hits[rows] >= self.settings.min_hits]
        shown = rows[self._hits[rows] >= self.settings.min_hits]
        return Tracks(self._id[shown], d.box, self._label()[shown], d.confidence, d.mask)

    def _drop_lost(self) -> None:
        boxes = states_to_boxes(self._filter.mean)
        limit = np.array([self.camera.width, self.camera.height] if self.camera else [np.inf, np.inf])
        in_view = ((boxes[:, 2:] > 0) & (boxes[:, :2] < limit)).all(axis=1)
        in_map = np.isfinite(self._corners).all(axis=(1, 2)) & in_view
        keep = self._age <= np.where(in_map, self.settings.max_age_in_map, self.settings.max_age)
        self._filter.keep(keep)
        self._id, self._hits, self._age = self._id[keep], self._hits[keep], self._age[keep]
        self._votes, self._corners = self._votes[keep], self._corners[keep]

    def _label(self) -> NDArray[np.uint8]:
        """Label (T,) of the most confident votes."""
        return np.asarray(self._votes.argmax(axis=1), dtype=np.uint8)


def _overlaps(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """IoU (A, B), and the share (A, B) of each box of `a` that lies in each of `b`."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.clip(high - low, 0.0, None).prod(axis=2)
    area_a = np.maximum((a[:, 2:] - a[:, :2]).prod(axis=1), 1e-9)[:, None]
    area_b = np.maximum((b[:, 2:] - b[:, :2]).prod(axis=1), 1e-9)[None, :]
    return shared / (area_a + area_b - shared), shared / area_a


def _assign(rows: NDArray[np.int64], score: NDArray[np.float64]) -> None:
    """Give detections without a track the one that maximises the total score (D, T); zero means impossible."""
    free_detections = np.flatnonzero(rows < 0)
    free_tracks = np.setdiff1d(np.arange(score.shape[1]), rows)
    open_score = score[np.ix_(free_detections, free_tracks)]
    d, t = linear_sum_assignment(open_score, maximize=True)
    possible = open_score[d, t] > 0
    rows[free_detections[d[possible]]] = free_tracks[t[possible]]
