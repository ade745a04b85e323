"""A time window of observations and the diff that it closes with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.vehicle.diffing.found import FoundLandmarks
from autowaze.vehicle.diffing.instances import InstanceRecord
from autowaze.vehicle.diffing.novelty import near_path, new_features, replaced_features
from autowaze.vehicle.diffing.registration import RowRegistration
from autowaze.vehicle.diffing.removal import LookedFor, removed_features
from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.vehicle.diffing.stored_watch import StoredFeatureWatch
from autowaze.vehicle.diffing.turning_points import turning_points
from autowaze.vehicle.ground import GroundObservation
from autowaze.vehicle.ground_grid import GroundGrid, ground_that_matters
from autowaze.vehicle.semantics.motion import Motions
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.camera import StereoCamera
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.features import CameraFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.ground import GroundCells
from autowaze.world.identity import MAX_SEQUENCE, feature_ids, instance_keys
from autowaze.world.instances import Tracks
from autowaze.world.labels import is_movable
from autowaze.world.map_diff import SemanticMapDiff, Trajectory
from autowaze.world.parking import ParkingMap
from autowaze.world.pose import heading_of

_UNSURE_M = 1.0  # of a position that is not that of half a bay: what was seen from there is put down elsewhere
_CELLS_PER_BYTE, _BYTES_OF_THE_REST = 8, 1000  # on the wire: ground; instances, traffic, path


@dataclass(frozen=True)
class FrameObservation:
    """Everything that one frame contributes to the diff."""

    tracked: TrackedFrame
    features: CameraFeatures
    tracks: Tracks
    motions: Motions
    ground: GroundObservation | None


class DiffWindow:
    """Gathers frames and closes with what changed against the stored map.

    Attributes:
        looked_for: the stored features that the last closed window should have seen, and what it saw.
    """

    def __init__(
        self,
        camera: StereoCamera,
        session: int,
        settings: DiffSettings,
        stored_map: FeatureMap | None = None,
        georeference: Georeference | None = None,
        spots: ParkingMap | None = None,
    ) -> None:
        self.camera = camera
        self.session = session
        self.settings = settings
        self.georeference = georeference
        self._stored = stored_map or FeatureMap(georeference=georeference)
        self._sequence = 0
        self._session_begun = self._session_ended = 0.0
        self._sent = np.zeros(0, np.int64)
        self._removed = np.zeros(0, np.uint64)
        self.looked_for = LookedFor.empty()
        self._found = FoundLandmarks(camera)
        self._ground = GroundGrid(self._area_of(spots))
        self._rows = RowRegistration(self._of_this_frame(spots))
        self._place: tuple[NDArray[np.float64], float] | None = None
        self._open()

    @property
    def start(self) -> float | None:
        """Time of the window's first frame; None while it is empty."""
        return self._times[0] if self._times else None

    @property
    def is_told(self) -> bool:
        """Whether nothing is left to tell: no frame since the last window, and no ground that waits to be passed."""
        return self.start is None and len(self._ground.classes()) == 0

    @property
    def is_complete(self) -> bool:
        """Whether a frame as long after the last one as that came after its own predecessor would be too late."""
        if len(self._times) < 2:
            return False
        interval = self._times[-1] - self._times[-2]
        return self._times[-1] - self._times[0] + interval >= self.settings.window_s - interval / 2

    @property
    def is_session_over(self) -> bool:
        """Whether the next window needs another session: numbers or time of this one have run out."""
        lasts_s = self._session_ended - self._session_begun if self._sequence else 0.0
        return self._sequence >= MAX_SEQUENCE or lasts_s + self.settings.window_s > self.settings.session_s

    def begin_session(self, session: int) -> None:
        """Go on under another session number, between two windows; what was sent stays sent."""
        self.session = session
        self._sequence = 0
        self._instances = InstanceRecord(session)

    def replace_stored(self, stored: FeatureMap) -> None:
        """Compare with another version of the map from here on; raises `AutowazeError` in the middle of a window."""
        if self._times:
            raise AutowazeError("the stored map can change between two windows only")
        self._stored = stored
        self._open()

    def replace_spots(self, spots: ParkingMap) -> None:
        """Tell of the ground at these spots from here on; raises `AutowazeError` in the middle of a window."""
        if self._times:
            raise AutowazeError("the spots can change between two windows only")
        self._ground.area = self._area_of(spots)
        self._rows.look_after(self._of_this_frame(spots))

    def _of_this_frame(self, spots: ParkingMap | None) -> ParkingMap | None:
        """The spots; None if they are not known, or in another map frame."""
        return spots if spots is not None and spots.georeference == self.georeference else None

    def _area_of(self, spots: ParkingMap | None) -> shapely.Geometry | None:
        """The ground to tell of; all if the spots are not known here."""
        return ground_that_matters(here) if (here := self._of_this_frame(spots)) is not None else None

    def add(self, observation: FrameObservation, landmarks: Landmarks) -> None:
        """Count one frame."""
        tracked = observation.tracked
        self._times.append(tracked.timestamp)
        if not tracked.is_trustworthy:
            return
        if self._sigmas and self._sigmas[-1] > _UNSURE_M and self._is_sure(tracked):
            self._take_back()
        self._note_path(tracked)
        self._found.add(tracked, observation.features, self._is_map_thin(tracked, observation.features, landmarks))
        self._instances.add(observation.tracks, observation.motions, tracked.T_map_cam)
        if observation.ground is not None:
            self._ground.add(observation.ground)
        if self._can_judge(tracked):
            self._localized += 1
            if observation.ground is not None:  # without dense depth nobody knows what is hidden
                self._stored_watch.add(tracked, observation.features, observation.ground, landmarks)

    def close(self, landmarks: Landmarks, last: bool = False) -> SemanticMapDiff:
        """The window's diff; the next window opens, unless it was the last: then nothing is left to be told later."""
        if not self._times and self._place is not None:  # what waited is told from where the car came to
            self._times.append(self._session_ended)
            self._path.append((self._session_ended, *self._place))
        removed = self._removed_ids()
        self._removed = np.union1d(self._removed, removed)
        ground = self._told_ground(last)
        new, sent, replaced = self._new_features(landmarks, len(ground))
        self._sent = np.union1d(self._sent, sent)
        removed = np.union1d(removed, replaced)
        self._removed = np.union1d(self._removed, replaced)
        diff = SemanticMapDiff(
            session=self.session,
            sequence=self._sequence,
            start=self._times[0],
            end=self._times[-1],
            map_version=self._stored.version,
            georeference=self.georeference,
            frames=len(self._times),
            localized_frames=len(self._sigmas),
            position_sigma_m=float(np.median(self._sigmas)) if self._sigmas else 0.0,
            new=new,
            removed=removed,
            instances=self._instances.summaries(np.unique(new.instance_key)),
            ground=ground,
            traffic=self._instances.traffic(),
            trajectory=self._path_positions(),
        )
        diff = self._rows.registered(diff, *self._registered_by())
        self._session_begun = diff.start if self._sequence == 0 else self._session_begun
        self._session_ended = diff.end
        self._sequence += 1
        self._open()
        return diff

    def _open(self) -> None:
        self._times: list[float] = []
        self._forget()

    def _take_back(self) -> None:
        """The map was found: what was seen so far is elsewhere."""
        self._ground.forget()
        self._forget()

    def _forget(self) -> None:
        self._sigmas: list[float] = []
        self._path: list[tuple[float, NDArray[np.float64], float]] = []
        self._localized = 0
        self._found.clear()
        self._stored_watch = StoredFeatureWatch(self._stored.features, self.settings.known_radius_m, self.camera)
        self._instances = InstanceRecord(self.session)

    def _registered_by(self) -> tuple[NDArray[np.float64], float | None, bool]:
        """The window's path (F, 2), how sure its first place is (None if the car was lost), whether the map held it."""
        places = [position for _, position, _ in self._path] + ([self._place[0]] if self._place else [])
        sigma = self._sigmas[0] if self._sigmas else np.inf
        is_lost = 0 < len(self._sigmas) < len(self._times)
        held = 2 * self._localized >= len(self._times)
        return np.array(places, np.float64).reshape(-1, 3)[:, :2], None if is_lost else sigma, held

    def _told_ground(self, last: bool) -> GroundCells:
        if last:
            return self._ground.classes()
        if not self._path or self._place is None:
            return GroundCells.empty()
        position, heading = self._place
        return self._ground.tell(position[:2], heading)

    def _note_path(self, tracked: TrackedFrame) -> None:
        self._sigmas.append(tracked.position_sigma_m)
        self._place = tracked.T_map_cam[:3, 3].copy(), heading_of(tracked.T_map_cam)
        if not self._path or tracked.timestamp >= self._path[-1][0] + self.settings.trajectory_interval_s - 1e-6:
            self._path.append((tracked.timestamp, *self._place))

    def _path_positions(self) -> Trajectory:
        if not self._path:
            return Trajectory.empty()
        times, positions, headings = zip(*self._path, strict=True)
        path = Trajectory(np.array(times), np.array(positions), np.array(headings, dtype=np.float32))
        return path[turning_points(path, self.settings.trajectory_tolerance_m)]

    def _is_map_thin(self, tracked: TrackedFrame, features: CameraFeatures, landmarks: Landmarks) -> bool:
        """Whether a frame found fewer standing features of the stored map than others need to localise well."""
        standing = tracked.landmark_id[~is_movable(features.label)]
        rows = landmarks.rows(standing[standing >= 0])
        stored = int((landmarks.map_id[rows[rows >= 0]] > 0).sum())
        return stored < self.settings.enough_stored

    def _can_judge(self, tracked: TrackedFrame) -> bool:
        return len(self._stored) > 0 and self._is_sure(tracked)

    def _is_sure(self, tracked: TrackedFrame) -> bool:
        is_localized = tracked.state is TrackingState.LOCALIZED
        return is_localized and tracked.position_sigma_m <= self.settings.max_position_sigma_m

    @property
    def _may_tell_removals(self) -> bool:
        return self._localized >= self.settings.min_localized_fraction * len(self._times)

    def _removed_ids(self) -> NDArray[np.uint64]:
        seen = self.looked_for = self._stored_watch.looked_for()
        if not self._may_tell_removals:
            return np.zeros(0, np.uint64)
        removed = seen.map_id[removed_features(seen, self.settings)]
        return np.setdiff1d(removed, self._removed)

    def _new_features(
        self, landmarks: Landmarks, n_cells: int
    ) -> tuple[MapFeatures, NDArray[np.int64], NDArray[np.uint64]]:
        """New features in wire order, the landmarks that they are, and ids of stored ones in whose place they are."""
        candidates = self._found.candidates(landmarks, self._sent, self.settings)
        stored = self._stored.features
        stored = stored[near_path(stored.position, [position for _, position, _ in self._path])]
        stored = stored[~np.isin(stored.id, self._removed)]
        comes_and_goes = is_movable(stored.label)
        budget = self.settings.max_diff_bytes - _BYTES_OF_THE_REST - n_cells // _CELLS_PER_BYTE
        chosen = new_features(
            candidates,
            self._instances.moving_ids(),
            stored.position[comes_and_goes],
            stored.position[~comes_and_goes],
            self.settings,
            budget,
        )
        movable = stored[comes_and_goes]
        replaced = replaced_features(candidates, chosen, movable.position, movable.instance_key, self.settings)
        replaced &= self._may_tell_removals
        rows = landmarks.rows(candidates.landmark_id[chosen])
        described = ~is_movable(candidates.label[chosen])
        n = len(chosen)
        new = MapFeatures(
            id=feature_ids(self.session, self._sequence, n),
            position=candidates.position[chosen],
            descriptor=landmarks.descriptor[rows] * described[:, None].astype(np.uint8),
            normal=landmarks.normal[rows].copy(),
            min_distance=landmarks.min_distance[rows].copy(),
            max_distance=landmarks.max_distance[rows].copy(),
            label=candidates.label[chosen],
            instance_key=instance_keys(self.session, candidates.instance[chosen]),
            first_seen=np.full(n, self._times[0]),
            last_seen=np.full(n, self._times[-1]),
            observations=np.minimum(candidates.found[chosen], 0xFFFF).astype(np.uint16),
        )
        return new, candidates.landmark_id[chosen], movable.id[replaced]
