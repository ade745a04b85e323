"""The whole car in one page (thesis, Fig. 3.2): stereo frames in, semantic map diffs out."""

from __future__ import annotations

import secrets
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from random import Random
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from autowaze.vehicle.diffing import DiffSettings, DiffWindow, FrameObservation
from autowaze.vehicle.ground import GroundObservation, GroundObserver
from autowaze.vehicle.semantics.association import associate
from autowaze.vehicle.semantics.motion import MotionClassifier, Motions
from autowaze.vehicle.semantics.perception import SemanticPerception
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.vehicle.semantics.street_view import StreetView
from autowaze.vehicle.slam.gnss_constraint import GnssPosition
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackedFrame
from autowaze.vehicle.vision.extractor import FeatureExtractor
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import FeatureMap
from autowaze.world.features import CameraFeatures
from autowaze.world.frame import StereoFrame
from autowaze.world.georeference import Georeference
from autowaze.world.identity import ROW_BITS, SEQUENCE_BITS, SESSION_BITS
from autowaze.world.instances import Detections, Tracks
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.map_update import MapUpdate
from autowaze.world.parking import ParkingMap
from autowaze.world.pose import Pose, heading_to_rotation, make_pose
from autowaze.world.stage_times import StageTimes

_COURSE_SIGMA_RAD = 0.05  # of a receiver's course over ground


class NodeSettings(BaseModel):
    """What can be set about a car.

    Attributes:
        segment_every: run the segmentation network on every n-th frame.
        spare_sky: do not show it what is high above the street.
        ground_every: look at the ground in every n-th frame.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    diff: DiffSettings = Field(default_factory=DiffSettings)
    segment_every: int = Field(default=1, ge=1)
    spare_sky: bool = True
    ground_every: int = Field(default=2, ge=1)


@dataclass(frozen=True)
class StartingPoint:
    """What a car knows of where it starts.

    Attributes:
        georeference: origin of the map frame; None takes the stored map's, else the first GNSS fix.
        T_map_cam: pose of the first frame where it is known exactly, as by a survey.
    """

    georeference: Georeference | None = None
    T_map_cam: Pose | None = field(default=None)


class Extractor(Protocol):
    """What turns a stereo frame into camera features."""

    def extract(self, frame: StereoFrame) -> CameraFeatures:
        """Features of the frame, not yet labelled."""


class VehicleNode:
    """One car: feed it frames, send the diffs that it returns.

    Args:
        spots: where people park: the car tells of the ground there alone, and of all the ground if it does not know.
    """

    def __init__(
        self,
        camera: StereoCamera,
        segmenter: Segmenter,
        settings: NodeSettings | None = None,
        stored_map: FeatureMap | None = None,
        start: StartingPoint | None = None,
        session: int | None = None,
        extractor: Extractor | None = None,
        spots: ParkingMap | None = None,
    ) -> None:
        self.camera = camera
        self.settings = settings or NodeSettings()
        self.stored_map = stored_map
        # A car that is given its session draws the next ones from it, so that the same drive gives the same bytes.
        self._draw = partial(secrets.randbits if session is None else Random(session).getrandbits, SESSION_BITS)
        self.sessions = [self._draw() if session is None else session]
        self.times = StageTimes()
        self.observation: FrameObservation | None = None
        self._start = start or StartingPoint()
        self._spots = spots
        self._extractor = extractor or FeatureExtractor(camera)
        eyes = StreetView(segmenter, camera) if self.settings.spare_sky else segmenter
        self._perception = SemanticPerception(eyes, self.settings.segment_every, camera)
        self._motion = MotionClassifier(camera)
        self._ground = GroundObserver(camera)
        self._segmentation_thread = ThreadPoolExecutor(1, "segmentation")
        self._frames = 0

    @property
    def session(self) -> int:
        """The number of the vehicle session that goes on."""
        return self.sessions[-1]

    def process(self, frame: StereoFrame) -> SemanticMapDiff | None:
        """Take in the next frame; the diff of the window that it completes, if it does."""
        if self._frames == 0:
            self._begin(frame)
        detecting = self._segmentation_thread.submit(self._detect, frame)
        with self.times.stage("features"):
            features = self._extractor.extract(frame)
        # What needs no detections is done while the network is busy.
        with self.times.stage("foretelling"):
            foretold = self.slam.foretell(features)
        disparity = self._dense_disparity(frame)
        detections = detecting.result()
        with self.times.stage("object tracking"):
            tracks = self._perception.track(detections, features, foretold, self._motion.moving_ids)
        with self.times.stage("association"):
            features = associate(features, tracks)
        with self.times.stage("slam"):
            on_moving = np.isin(features.instance_id, self._motion.moving_ids)
            tracked = self.slam.track(features, frame.timestamp, frame.index, self._gnss_position(frame), on_moving)
        with self.times.stage("motion"):
            motions = self._moved(features, tracked, frame, tracks)
        ground = self._look_at_ground(disparity, tracked, tracks)
        self._frames += 1
        self.observation = FrameObservation(tracked, features, tracks, motions, ground)
        with self.times.stage("diff"):
            self.window.add(self.observation, self.slam.landmarks)
        if not self.window.is_complete:
            return None
        with self.times.stage("closing"):
            return self._closed_window()

    def adopt(self, update: MapUpdate) -> None:
        """Change the stored map between two windows, that is before the first frame or after one that gave a diff.

        What this drive has sent itself is left out: it has those features already, as it sees them, and a car that
        localised in its own map would be sure of its own drift.

        Raises:
            AutowazeError: a window is open, or the update is for another version of the map; nothing has changed.
        """
        own = np.isin(update.added.id >> np.uint64(SEQUENCE_BITS + ROW_BITS), np.array(self.sessions, np.uint64))
        update = replace(update, added=update.added[~own])
        stored = self.stored_map
        if stored is None:
            stored = FeatureMap(georeference=self._start.georeference or update.georeference)
        changed = update.applied_to(stored)
        if self._frames:
            self.window.replace_stored(changed)
            self.slam.replace_stored_features(update.added[update.added.described], update.removed)
        self.stored_map = changed

    def look_after(self, spots: ParkingMap) -> None:
        """Tell of the ground at these spots from the next window on; a car that drives on learns of others."""
        self._spots = spots
        if self._frames:
            self.window.replace_spots(spots)

    def finish(self) -> SemanticMapDiff | None:
        """The diff of the last, shorter window; the car can take no more frames."""
        self._segmentation_thread.shutdown()
        if self._frames == 0:
            return None
        self.slam.finish()
        return None if self.window.is_told else self._closed_window(last=True)

    def _begin(self, frame: StereoFrame) -> None:
        """Set out from what is known: the stored map, the start, the first fix."""
        stored, fix = self.stored_map, frame.gnss
        self.georeference = self._start.georeference or (stored.georeference if stored else None)
        if self.georeference is None and fix is not None:
            self.georeference = Georeference(fix.lat_deg, fix.lon_deg, fix.altitude_m)
        here, T_start, start_sigma = self._gnss_position(frame), self._start.T_map_cam, (0.0, 0.0)
        if T_start is None and fix is not None and here is not None and (fix.heading_rad is not None or not stored):
            T_start = make_pose(heading_to_rotation(fix.heading_rad or 0.0), here.position)
            start_sigma = (here.sigma_m, _COURSE_SIGMA_RAD)
        prior = None if here is None else (here.position, here.sigma_m)
        # Features without descriptor are for the diff, nobody can localise by them.
        localizing = FeatureMap(stored.features[stored.features.described], stored.georeference) if stored else None
        self.slam = StereoSlam(
            self.camera, stored_map=localizing, T_map_start=T_start, position_prior=prior, start_sigma=start_sigma
        )
        self.window = DiffWindow(self.camera, self.session, self.settings.diff, stored, self.georeference, self._spots)

    def _closed_window(self, last: bool = False) -> SemanticMapDiff:
        """The window's diff; the next one may be of another session."""
        diff = self.window.close(self.slam.landmarks, last)
        if self.window.is_session_over:
            self.sessions.append(self._draw())
            self.window.begin_session(self.session)
        return diff

    def _detect(self, frame: StereoFrame) -> Detections:
        with self.times.stage("segmentation"):
            return self._perception.detect(frame)

    def _gnss_position(self, frame: StereoFrame) -> GnssPosition | None:
        if frame.gnss is None or self.georeference is None:
            return None
        fix = frame.gnss
        position = self.georeference.to_map(np.array([[fix.lon_deg, fix.lat_deg]]), fix.altitude_m)[0]
        return GnssPosition(np.asarray(position), fix.horizontal_sigma_m)

    def _moved(self, features: CameraFeatures, tracked: TrackedFrame, frame: StereoFrame, tracks: Tracks) -> Motions:
        """Motion in the map; a pose that is only guessed would set everything in motion."""
        if not tracked.is_trustworthy:
            return Motions.empty()
        return self._motion.update(features, tracked.T_map_cam, frame.timestamp, tracks)

    def _dense_disparity(self, frame: StereoFrame) -> NDArray[np.float32] | None:
        """Of the frames whose ground is looked at."""
        if self._frames % self.settings.ground_every:
            return None
        with self.times.stage("dense stereo"):
            return self._ground.disparity(frame)

    def _look_at_ground(
        self, disparity: NDArray[np.float32] | None, tracked: TrackedFrame, tracks: Tracks
    ) -> GroundObservation | None:
        if disparity is None or not tracked.is_trustworthy:
            return None
        with self.times.stage("ground"):
            moving = np.isin(tracks.id, self._motion.moving_ids)
            mask = np.asarray(tracks.mask[moving].any(axis=0)) if moving.any() else None
            return self._ground.cells_of(disparity, tracked.T_map_cam, mask)
