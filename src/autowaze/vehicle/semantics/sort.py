"""SORT: simple online and realtime tracking (Bewley et al. 2016), and what a moving stereo camera adds to it.

The paper: a Kalman filter foretells each track's box, the Hungarian method assigns detections by IoU. A car that
drives past parked ones sees their boxes sweep through the image and hide each other. Where its pose and their depth
are known, the filter is told how the box of a standing object moves, detections at another depth are refused, and
a hidden object is waited for where it stands.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autowaze.vehicle.semantics.assignment import assign, overlaps
from autowaze.vehicle.semantics.billboard import Billboards
from autowaze.vehicle.semantics.borrowed_depth import without_borrowed
from autowaze.vehicle.semantics.box_filter import BoxFilter, boxes_to_measurements, states_to_boxes
from autowaze.vehicle.semantics.classes import kinds
from autowaze.vehicle.semantics.gallery import Gallery
from autowaze.vehicle.semantics.instance_depth import InstanceDepths
from autowaze.vehicle.semantics.seniority import prefer_elders
from autowaze.vehicle.semantics.sort_settings import SortSettings
from autowaze.vehicle.semantics.whereabouts import LENGTH_M, GroundPlane, Sightings, Whereabouts, look
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections, Tracks
from autowaze.world.labels import ClassLabel, is_vehicle
from autowaze.world.pose import Pose

_CALM_GAIN = 0.1  # one frame's weight in whether a track stands: a car that passes before it bends its box for several
_BORDER_PX = 2.0  # a box that comes as near to the border of the image as this is cut by it


class Sort:
    """Gives detections ids that hold over frames; plain SORT without a camera or without poses and depths."""

    def __init__(self, camera: StereoCamera | None = None, settings: SortSettings | None = None) -> None:
        self.camera = camera
        self.settings = settings or SortSettings()
        self._filter = BoxFilter()
        self._billboards = Billboards(camera) if camera is not None else None
        self._id = np.zeros(0, np.int32)
        self._hits = np.zeros(0, np.int64)
        self._age = np.zeros(0, np.int64)
        self._votes = np.zeros((0, len(ClassLabel)))
        self._last_box = np.zeros((0, 4))
        self._calm = np.zeros(0)
        self._next_id = 1
        self._frame = 0
        self._first_seen = np.zeros(0, np.int64)
        self._ground: GroundPlane | None = None
        self._whereabouts = Whereabouts()
        self._gallery = Gallery()

    def update(
        self,
        detections: Detections,
        T_map_cam: Pose | None = None,
        depths: InstanceDepths | None = None,
        moving_ids: ArrayLike = (),
    ) -> Tracks:
        """Tracks of the next frame.

        Args:
            detections: instances of the frame.
            T_map_cam: pose of the frame or its prediction; None for plain SORT.
            depths: how far away the detections are (`instance_depth.measure_depths`); None for plain SORT.
            moving_ids: of tracks known to move; a car ahead at our own speed stays in its place in the image.

        Returns:
            The detections that belong to a reported track, in their order, with the label most often seen.
        """
        self._frame += 1
        self._calm[np.isin(self._id, moving_ids)] = 0.0
        measured = boxes_to_measurements(detections.box)
        depths = depths if depths is not None else InstanceDepths.unknown(len(detections))
        depths = without_borrowed(self.camera, detections, depths) if self.camera is not None else depths
        # a rate measured while another object slid before it is not the object's own
        self._filter.forget_rates(np.flatnonzero((self._age > 0) & self._waits_in_map()))
        self._filter.predict(self._billboards.shift(T_map_cam) if self._billboards else np.zeros((len(self._id), 4)))
        cut = self._cut(detections.box)
        rows = self._match(detections, depths, cut)
        self._age += 1
        known = rows >= 0
        self._correct(rows[known], measured[known])
        rows[~known] = self._start_tracks(measured[~known])
        sightings = self._look(detections, depths, T_map_cam)
        if sightings is not None:
            self._recognise(rows, ~known & is_vehicle(detections.label), sightings)
        self._filter.forget_rates(rows[cut.any(axis=1)])
        self._age[rows] = 0
        self._hits[rows] += 1
        self._votes[rows, detections.label] += detections.confidence
        self._last_box[rows] = detections.box
        self._calm[rows] += _CALM_GAIN * (self._keeps_place()[rows] - self._calm[rows])
        if self._billboards:
            self._billboards.place(rows, detections.box, detections.label, depths)
        tracks = self._report(rows, detections)
        self._drop_lost()
        return tracks

    def _match(self, detections: Detections, depths: InstanceDepths, cut: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Row (D,) of the track that each detection continues, -1 for none; `cut` (D, 4) by which borders."""
        boxes, foretold = np.asarray(detections.box, np.float64), self._foretold()
        iou, containment = overlaps(boxes, foretold)
        same_kind = kinds(detections.label)[:, None] == kinds(self._label())[None, :]
        waits = self._waits_in_map()
        elsewhere, agree, far_end = self._compare_depths(depths, waits)
        widest = np.nan_to_num(self._billboards.widest_boxes()) if self._billboards else None
        rows = np.full(len(detections), -1, np.int64)
        s = self.settings
        seen_before = (self._age == 0)[None, :]
        enough = iou >= np.where(self._age == 0, s.min_iou, s.min_iou_waiting)[None, :]
        assign(rows, np.where(same_kind & ~elsewhere & enough, iou, 0.0))
        # A sliver of what was just seen whole is too small for a depth; or the far end is all that is left to see.
        fits = agree | ((np.isnan(depths.left)[:, None] | far_end) & seen_before)
        assign(rows, np.where(same_kind & fits & (containment >= s.min_containment), containment, 0.0))
        assign(rows, np.where(same_kind & elsewhere & (iou >= s.min_iou_elsewhere), iou, 0.0))
        # Of what another thing slides before, now this part is seen and now that.
        if widest is not None:
            whole, part = overlaps(boxes, widest)
            possible = same_kind & agree & waits & (part >= s.min_containment)
            assign(rows, np.where(possible, part, 0.0))
            assign(rows, np.where(same_kind & far_end & seen_before & (iou >= s.min_iou), iou, 0.0))
        # What leaves the image shrinks within its box to a bonnet in the corner, too small for a depth.
        there, still_inside = overlaps(boxes, self._last_box)
        leaving = seen_before & (cut[:, None, ::2] & self._cut(self._last_box)[None, :, ::2]).any(axis=2)
        inside = still_inside >= s.min_containment
        assign(rows, np.where(same_kind & leaving & inside & ~elsewhere, still_inside, 0.0))
        # The place of what is very near, or half hidden, is foretold badly; what nothing else explains and fills the
        # box of the frame before is what was there.
        assign(rows, np.where(same_kind & seen_before & (there >= s.min_iou_in_place), there, 0.0))
        if self._billboards:
            self._match_in_map(rows, detections, depths, same_kind & waits)
        # What hid it has passed: all that was seen before is now a part of it.
        swallowed = np.maximum(overlaps(self._last_box, boxes)[1], overlaps(foretold, boxes)[1]).T
        uncovered = swallowed >= s.min_containment
        assign(rows, np.where(same_kind & seen_before & uncovered & ~elsewhere, swallowed, 0.0))
        # The depth of a thin person is easily that of the wall behind; nobody walks far in a frame.
        thin = same_kind & ~is_vehicle(detections.label)[:, None] & seen_before
        assign(rows, np.where(thin & (there >= s.min_iou), there, 0.0))
        if widest is not None:
            area = (detections.box[:, 2:] - detections.box[:, :2]).prod(axis=1)
            possible = same_kind & agree & is_vehicle(detections.label)[:, None]
            prefer_elders(rows, self._hits, area, np.maximum(iou, whole), possible)
        return rows

    def _match_in_map(
        self, rows: NDArray[np.int64], detections: Detections, depths: InstanceDepths, may_be: NDArray[np.bool_]
    ) -> None:
        """Give vehicles that nothing explains the hidden tracks that stand where they are.

        Of a car that another slides before, the end that comes to sight is seldom the one that was seen last; the
        boxes of both may have nothing in common.
        """
        assert self._billboards is not None
        apart = self._billboards.distance(detections.box, depths)
        limit = np.where(np.isnan(depths.left), self.settings.max_across_m, self.settings.max_apart_m)[:, None]
        possible = may_be & is_vehicle(detections.label)[:, None] & (self._age > 0) & (apart < limit)
        unexplained = rows < 0
        assign(rows, np.where(possible, 1.0 - apart / limit, 0.0))
        found = rows[unexplained & (rows >= 0)]
        self._billboards.forget_place(found)
        self._filter.forget_rates(found)

    def _correct(self, rows: NDArray[np.int64], measured: NDArray[np.float64]) -> None:
        """Take in boxes (n, 4); one that has little in common with the foretold one is of another part of the thing."""
        iou, _ = overlaps(states_to_boxes(measured), states_to_boxes(self._filter.mean[rows]))
        like = np.diag(iou) >= self.settings.min_iou
        self._filter.correct(rows[like], measured[like])
        self._filter.restart(rows[~like], measured[~like])

    def _look(self, detections: Detections, depths: InstanceDepths, T_map_cam: Pose | None) -> Sightings | None:
        """Where over ground the detections stand, if they are vehicles; None without a camera or a pose."""
        if self.camera is None or T_map_cam is None:
            return None
        self._ground = self._ground or GroundPlane(T_map_cam)
        return look(self.camera, self._ground, T_map_cam, detections.box, detections.label, depths)

    def _recognise(self, rows: NDArray[np.int64], fresh: NDArray[np.bool_], sightings: Sightings) -> None:
        """Give vehicles that come back into view the ids that they had, and take in where all are seen."""
        standing = is_vehicle(self._label()[rows]) & (self._calm[rows] > 0.5)
        self._gallery.forget(self._frame)
        self._gallery.correct_drift(sightings[standing | fresh])
        ids = self._gallery.recognise(sightings[fresh], self._id)
        self._id[rows[fresh]] = np.where(ids > 0, ids, self._id[rows[fresh]])
        self._whereabouts.take_in(rows, sightings)

    def _foretold(self) -> NDArray[np.float64]:
        """Boxes (T, 4); an edge that the border of the image cut in the frame before is still there."""
        boxes = states_to_boxes(self._filter.mean)
        cut = self._cut(self._last_box) & (self._age == 0)[:, None]
        return np.where(cut, self._last_box, boxes)

    def _cut(self, boxes: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Which edges (N, 4) of boxes the border of the image makes."""
        if self.camera is None:
            return np.zeros(boxes.shape, np.bool_)
        limit = np.array([self.camera.width, self.camera.height]) - _BORDER_PX
        return np.concatenate([boxes[:, :2] <= _BORDER_PX, boxes[:, 2:] >= limit], axis=1)

    def _compare_depths(self, depths: InstanceDepths, waits: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
        """Which detections lie wholly before or behind a track, at its depth, or where its far end may; (D, T) each."""
        if self._billboards is None:
            nothing = np.zeros((len(depths), len(self._id)), np.bool_)
            return nothing, nothing, nothing
        track = self._billboards.depth()[None, :]
        tolerance = self._billboards.tolerance(track)
        near, far = depths.near[:, None], depths.far[:, None]
        middle = (depths.left + depths.right)[:, None] / 2
        elsewhere = (near > track + tolerance) | (far < track - tolerance)
        length = LENGTH_M[self._label()] * is_vehicle(self._label())
        behind = (middle > track) & (near <= track + length + tolerance)
        return elsewhere, np.abs(middle - track) <= tolerance, behind & waits

    def _start_tracks(self, measured: NDArray[np.float64]) -> NDArray[np.int64]:
        """Append a track per measured box (n, 4); returns their rows (n,)."""
        n, first = len(measured), len(self._id)
        self._filter.add(measured)
        if self._billboards:
            self._billboards.add(n)
        self._id = np.concatenate([self._id, np.arange(self._next_id, self._next_id + n, dtype=np.int32)])
        self._next_id += n
        self._hits = np.concatenate([self._hits, np.zeros(n, np.int64)])
        self._age = np.concatenate([self._age, np.zeros(n, np.int64)])
        self._votes = np.concatenate([self._votes, np.zeros((n, len(ClassLabel)))])
        self._last_box = np.concatenate([self._last_box, np.zeros((n, 4))])
        self._calm = np.concatenate([self._calm, np.ones(n)])
        self._first_seen = np.concatenate([self._first_seen, np.full(n, self._frame)])
        self._whereabouts.add(n)
        return first + np.arange(n)

    def _report(self, rows: NDArray[np.int64], detections: Detections) -> Tracks:
        reported = self._hits[rows] >= self.settings.min_hits
        d, shown = (detections, rows) if reported.all() else (detections[reported], rows[reported])  # masks are large
        return Tracks(self._id[shown], d.box, self._label()[shown], d.confidence, d.mask)

    def _drop_lost(self) -> None:
        s = self.settings
        is_traffic = (self._hits >= s.seasoned) & (self._calm <= 0.5) & ~self._cut(self._last_box).any(axis=1)
        max_age = np.where(is_traffic, s.max_age_traffic, s.max_age)
        keep = self._age <= np.where(self._waits_in_map(), s.max_age_in_map, max_age)
        self._remember(~keep)
        self._filter.keep(keep)
        if self._billboards:
            self._billboards.keep(keep)
        self._id, self._hits, self._age = self._id[keep], self._hits[keep], self._age[keep]
        self._votes, self._last_box, self._calm = self._votes[keep], self._last_box[keep], self._calm[keep]
        self._first_seen = self._first_seen[keep]
        self._whereabouts.keep(keep)

    def _remember(self, lost: NDArray[np.bool_]) -> None:
        """Put parked vehicles that left the view into the gallery."""
        if self._billboards is None:
            return
        parked = np.flatnonzero(lost & self._billboards.placed & (self._calm > 0.5) & is_vehicle(self._label()))
        if len(parked):
            last_seen = self._frame - self._age[parked]
            self._gallery.put(self._id[parked], *self._whereabouts.places(parked), self._first_seen[parked], last_seen)

    def _waits_in_map(self) -> NDArray[np.bool_]:
        """Tracks (T,) whose place is known and in view, and whose box mostly moved as that of a standing object."""
        if self.camera is None or self._billboards is None:
            return np.zeros(len(self._id), np.bool_)
        boxes = states_to_boxes(self._filter.mean)
        in_view = (boxes[:, 2:] > 0) & (boxes[:, :2] < [self.camera.width, self.camera.height])
        return np.asarray((self._calm > 0.5) & in_view.all(axis=1) & self._billboards.placed & self._billboards.ahead)

    def _keeps_place(self) -> NDArray[np.bool_]:
        """Tracks (T,) whose box moves now as that of a standing object."""
        drift = np.hypot(self._filter.mean[:, 4], self._filter.mean[:, 5])
        return np.asarray(drift < self.settings.max_drift * np.sqrt(self._filter.mean[:, 2]) + 1.0)

    def _label(self) -> NDArray[np.uint8]:
        """Label (T,) with the most confident votes."""
        return np.asarray(self._votes.argmax(axis=1), dtype=np.uint8)
