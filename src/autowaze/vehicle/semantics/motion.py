"""Parked or moving, by how an instance's features move in the map frame once the car's own motion is taken out.

The centroid of an instance is no witness: the side that is seen slides along a parked car as one drives by. The same
point of it, found again, is. Stereo places points along the line of sight with an error that grows with the square
of the depth, so a displacement counts for as much as its covariance allows, and evidence adds up over frames.
When the pose jumps, as it does on being found again in the map, the background jumps along and tells.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.displacement import (
    Sighting,
    Velocity,
    agreed_displacement,
    places_of,
    pose_jump,
)
from autowaze.vehicle.semantics.looming import SizeSight, sights_of
from autowaze.vehicle.semantics.motion_belief import MotionBelief, MotionSettings
from autowaze.vehicle.semantics.rematching import match_within_instances
from autowaze.world.camera import StereoCamera
from autowaze.world.columns import Columns
from autowaze.world.features import CameraFeatures
from autowaze.world.instances import Tracks
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import Pose, transform


@dataclass
class Motions(Columns):
    """Motion of the instances of one frame, N rows in ascending order of id.

    Attributes:
        id: (N,) int32, the track's id.
        label: (N,) uint8, a `ClassLabel`.
        moving: (N,) bool.
        position: (N, 2) float32, median of the instance's features, metres in the map frame.
        velocity: (N, 2) float32, m/s in the map frame; zero for what stands.
    """

    id: NDArray[np.int32]
    label: NDArray[np.uint8]
    moving: NDArray[np.bool_]
    position: NDArray[np.float32]
    velocity: NDArray[np.float32]

    @classmethod
    def empty(cls) -> Motions:
        """Nothing seen."""
        f32 = np.float32
        return cls(
            np.zeros(0, np.int32),
            np.zeros(0, np.uint8),
            np.zeros(0, np.bool_),
            np.zeros((0, 2), f32),
            np.zeros((0, 2), f32),
        )


_BACKGROUND_M, _BACKGROUND_FEATURES = 20.0, 300
_ALWAYS_CHANGED = 0.1  # share of the error of a disparity that is new in each frame


class MotionClassifier:
    """Tells moving instances from parked ones, over frames."""

    def __init__(self, camera: StereoCamera, settings: MotionSettings | None = None) -> None:
        self.camera = camera
        self.settings = settings or MotionSettings()
        self._sightings: deque[Sighting] = deque()
        self._background: Sighting | None = None
        self._jumps = np.zeros(3)
        self._ahead = np.array([0.0, 1.0])
        self._beliefs: dict[int, MotionBelief] = {}

    @property
    def moving_ids(self) -> NDArray[np.int32]:
        """Ids judged moving so far, ascending; serves the next frame before its pose is known."""
        return np.array(sorted(i for i, b in self._beliefs.items() if b.moving), dtype=np.int32)

    def update(
        self, features: CameraFeatures, T_map_cam: Pose, timestamp: float, tracks: Tracks | None = None
    ) -> Motions:
        """Motion of every instance that has features with depth in this frame.

        Args:
            features: with labels and instance ids (`association.associate`).
            T_map_cam: trusted pose of the frame.
            timestamp: seconds.
            tracks: the instances as they are seen; None leaves out what their size tells.
        """
        now = self._sight(features, T_map_cam, timestamp)
        sights = sights_of(self.camera, tracks, self._steady(T_map_cam), timestamp) if tracks is not None else {}
        self._ahead = T_map_cam[:2, 2] / max(float(np.linalg.norm(T_map_cam[:2, 2])), 1e-9)
        ids, first = np.unique(now.instance, return_index=True)
        self._remember(ids, now.label[first], timestamp)
        self._judge(now, sights)
        self._sightings.append(now)
        beliefs = [self._beliefs[int(i)] for i in ids]
        moving = np.array([b.moving for b in beliefs], np.bool_)
        velocity = np.array([b.velocity for b in beliefs]).reshape(-1, 2) * moving[:, None]
        bounds = np.append(first, len(now.instance))
        in_map = now.position[:, :2] + self._jumps[:2]
        position = [np.median(in_map[a:b], axis=0) for a, b in pairwise(bounds)]
        return Motions(
            ids,
            now.label[first],
            moving,
            np.array(position, np.float32).reshape(-1, 2),
            velocity.astype(np.float32),
        )

    def _sight(self, features: CameraFeatures, T_map_cam: Pose, timestamp: float) -> Sighting:
        near = (features.instance_id == 0) & (features.depth < _BACKGROUND_M)
        background = self._place(features, np.flatnonzero(near)[:_BACKGROUND_FEATURES], T_map_cam, timestamp)
        if self._background is not None:
            jump = pose_jump(background, self._background)
            self._jumps = self._jumps + jump
            background = replace(background, position=background.position - jump)
        self._background = background
        rows = np.flatnonzero((features.instance_id > 0) & features.has_depth)
        rows = rows[np.argsort(features.instance_id[rows], kind="stable")]
        return self._place(features, rows, T_map_cam, timestamp)

    def _steady(self, T_map_cam: Pose) -> Pose:
        """The pose without the jumps so far."""
        steady = T_map_cam.copy()
        steady[:3, 3] -= self._jumps
        return steady

    def _place(self, features: CameraFeatures, rows: NDArray[np.int64], T_map_cam: Pose, timestamp: float) -> Sighting:
        f = features[rows]
        covariances = self._covariances(f, T_map_cam[:3, :3])
        disparity = self.camera.bf / f.depth.astype(np.float64)
        position = transform(T_map_cam, f.position_cam.astype(np.float64)) - self._jumps
        return Sighting(timestamp, f.instance_id, f.label, f.descriptor, disparity, position, *covariances)

    def _covariances(
        self, f: CameraFeatures, R_map_cam: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Covariances (N, 3, 3) in m^2, map frame: of each feature alone, and of what it shares: pose, disparity."""
        s = self.settings
        depth = f.depth.astype(np.float64)
        ray = f.position_cam.astype(np.float64) / depth[:, None] @ R_map_cam.T
        along = ray[:, :, None] * ray[:, None, :] * (depth**2 / self.camera.bf)[:, None, None] ** 2
        image = R_map_cam[:, :2] @ R_map_cam[:, :2].T
        across = image[None] * (depth / self.camera.fx * f.scale * s.pixel_sigma)[:, None, None] ** 2
        turned = image[None] * (depth * s.pose_sigma_rad)[:, None, None] ** 2
        return (
            across + along * (f.scale * s.disparity_sigma)[:, None, None] ** 2,
            turned + np.eye(3) * s.pose_sigma_m**2 / 2,
            along * s.common_disparity_sigma**2,
        )

    def _remember(self, ids: NDArray[np.int32], labels: NDArray[np.uint8], timestamp: float) -> None:
        """Start beliefs of new instances, forget those long gone, drop sightings too old to compare with."""
        for instance, label in zip(ids.tolist(), labels.tolist(), strict=True):
            belief = self._beliefs.setdefault(instance, MotionBelief(self.settings, ClassLabel(label)))
            belief.last_seen = timestamp
        horizon = timestamp - self.settings.forget_s
        self._beliefs = {i: b for i, b in self._beliefs.items() if b.last_seen >= horizon}
        while self._sightings and timestamp - self._sightings[0].timestamp > 1.5 * self.settings.spans_s[0]:
            self._sightings.popleft()

    def _earlier(self, timestamp: float) -> list[Sighting]:
        """The sightings nearest to the wanted spans, the oldest first, each once."""
        found: list[Sighting] = []
        for span in self.settings.spans_s:
            past = [s for s in self._sightings if s.timestamp < timestamp]
            nearest = min(past, key=lambda s: abs(timestamp - s.timestamp - span), default=None)
            if nearest is not None and nearest not in found:
                found.append(nearest)
        return found

    def _judge(self, now: Sighting, sights: dict[int, SizeSight]) -> None:
        """Add the evidence of the longest span that can be believed, for each instance that is found again.

        Two wheels of a car look alike: taken for one they make it seem to drive. The way between them is the same
        over any span, while that of what moves grows with it, so motion must show at one speed over two spans.
        """
        judged: dict[int, Velocity] = {}
        claims: dict[int, Velocity] = {}
        earlier = self._earlier(now.timestamp)
        for number, sighting in enumerate(earlier):
            shortest = number + 1 == len(earlier)
            for instance, found in self._velocities(now, sighting, judged).items():
                claim = claims.get(instance)
                confirmed = claim is not None and claim.agrees_with(found)
                alone = shortest and claim is None  # a longer span could tell nothing
                if self._beliefs[instance].log_factor(found, self._ahead) > 0 and not confirmed and not alone:
                    claims[instance] = found
                    continue
                judged[instance] = claim if claim and confirmed else found
                self._beliefs[instance].weigh(judged[instance], self._ahead, self._elapsed(now))
        self._judge_by_places(now, sights, judged)

    def _judge_by_places(self, now: Sighting, sights: dict[int, SizeSight], judged: dict[int, Velocity]) -> None:
        """Add the evidence of where instances are: some are too small or too smooth to be found again by features.

        Which part of a vehicle is seen says nothing of its motion, but is never off by more than the vehicle is long.
        """
        elapsed = self._elapsed(now)
        for instance, place in places_of(now).items():
            belief, sight = self._beliefs[instance], sights.get(instance)
            if sight is not None:
                disparity = float(np.median(now.disparity[now.instance == instance]))
                depth = self.camera.bf / disparity
                depth_sigma = depth / disparity * self.settings.common_disparity_sigma
                sight = sight if belief.stature.agrees(sight, depth, depth_sigma) else None
            belief.take_place(place, sight, self._ahead, elapsed, judged.get(instance))

    def _elapsed(self, now: Sighting) -> float:
        return now.timestamp - self._sightings[-1].timestamp if self._sightings else 0.0

    def _velocities(self, now: Sighting, earlier: Sighting, judged: dict[int, Velocity]) -> dict[int, Velocity]:
        """Velocities of the instances that are found again in an earlier frame and not judged yet."""
        partner = match_within_instances(now.descriptor, now.instance, earlier.descriptor, earlier.instance)
        rows = np.flatnonzero(partner >= 0)
        partner = partner[rows]
        span = now.timestamp - earlier.timestamp
        displacement = now.position[rows] - earlier.position[partner]
        covariance = now.covariance[rows] + earlier.covariance[partner]
        # The stereo of a surface errs with the fraction of a pixel at which it is matched: as before, if that is.
        changed = np.minimum(np.abs(now.disparity[rows] - earlier.disparity[partner]), 1.0)[:, None, None]
        common = now.of_pose[rows] + earlier.of_pose[partner]
        common += np.maximum(changed, _ALWAYS_CHANGED) * (now.of_disparity[rows] + earlier.of_disparity[partner])
        ids, first, counts = np.unique(now.instance[rows], return_index=True, return_counts=True)
        found = {}
        for instance, start, n in zip(ids.tolist(), first.tolist(), counts.tolist(), strict=True):
            if instance in judged or n < self.settings.min_matches:
                continue
            part = slice(start, start + n)
            agreed = agreed_displacement(displacement[part], covariance[part], self.settings.min_matches)
            if agreed is not None:
                mean, spread = agreed
                P = (spread + common[part].mean(axis=0))[:2, :2] / span**2
                found[instance] = Velocity(mean[:2] / span, P, span)
        return found
