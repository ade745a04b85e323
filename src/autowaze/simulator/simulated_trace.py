"""A simulated drive as a trace: frames are rendered when they are asked for, the disk stays out of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.simulator.description import StreetDescription
from autowaze.simulator.drive import Drive, stage_drive
from autowaze.simulator.render.renderer import Renderer, right_camera
from autowaze.simulator.scene import Scene
from autowaze.simulator.sensor import Sensor, paint_lens_dirt
from autowaze.simulator.street import Street, build_street
from autowaze.simulator.surfaces.sky import paint_sky, paint_surroundings
from autowaze.simulator.truth import SpotView, VehicleState, view_spots
from autowaze.traces.trace import GroundTruth
from autowaze.world.camera import StereoCamera
from autowaze.world.frame import StereoFrame
from autowaze.world.pose import Pose

_SHADOW_MARGIN_M = 11.0


@dataclass(frozen=True)
class SimulatedFrame:
    """A frame with what only a simulator knows.

    Attributes:
        ids: (H, W) uint32 instance ids of the left image; 0 for what does not come and go.
        depth: (H, W) float32 metres along the left camera's axis; infinite in the sky.
        vehicles: boxes of all cars and trucks on the street, map frame.
        spots: spots of which the left camera sees something.
    """

    stereo: StereoFrame
    ids: NDArray[np.uint32]
    depth: NDArray[np.float32]
    T_map_cam: Pose
    vehicles: list[VehicleState]
    spots: list[SpotView]


class SimulatedTrace:
    """A street driven through, as a `Trace`; `trace.render(i)` gives the truth of a frame with it.

    Rendering starts with the first frame asked for and belongs to the process and thread that asks. `threads` caps
    the rasteriser's.
    """

    def __init__(self, description: StreetDescription, threads: int | None = None) -> None:
        self.description = description
        self._threads = threads
        self._sensor = Sensor(description.effects, description.seed + 7919 * description.drive)

    @cached_property
    def drive(self) -> Drive:
        """The street with its traffic and the ego's motion."""
        return stage_drive(build_street(self.description))

    @property
    def street(self) -> Street:
        """The street without its traffic."""
        return self.drive.street

    @property
    def name(self) -> str:
        """Name of the street with the seeds."""
        return f"{self.description.name}-{self.description.seed}-{self.description.drive}"

    @property
    def camera(self) -> StereoCamera:
        """Calibration of the rig."""
        return self.description.rig.camera

    @cached_property
    def ground_truth(self) -> GroundTruth:
        """T_map_cam of every frame: map east, north, up metres."""
        return GroundTruth(self.drive.ego.poses(), in_map_frame=True)

    @property
    def frame_numbers(self) -> NDArray[np.int64]:
        """Numbers of the frames, (N,)."""
        return np.arange(len(self), dtype=np.int64)

    def __len__(self) -> int:
        return len(self.drive)

    def __iter__(self) -> Iterator[StereoFrame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> StereoFrame:
        return self._render(index, truth=False).stereo

    def render(self, index: int) -> SimulatedFrame:
        """A frame with its ground truth."""
        return self._render(index, truth=True)

    def _render(self, index: int, truth: bool) -> SimulatedFrame:
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        ego, effects = self.drive.ego, self.description.effects
        time = float(ego.frame_times[index])
        T_map_cam = ego.pose(time)
        renderer = self._renderer
        renderer.place_moving(self.drive.moving_things(index), T_map_cam[:2, 3] + 18.0 * T_map_cam[:2, 2])
        before = ego.pose(time - effects.motion_blur_ms / 1000) if effects.motion_blur_ms > 0 else None
        left = renderer.render(T_map_cam, before, truth)
        wobble = self._sensor.wobble(index, self.camera.fx)
        right_before = None if before is None else right_camera(before, self.camera.baseline_m, wobble)
        right = renderer.render(right_camera(T_map_cam, self.camera.baseline_m, wobble), right_before, truth=False)
        stereo = StereoFrame(
            index,
            float(ego.timestamps[index]),
            self._sensor.expose(left.picture, index, 0),
            self._sensor.expose(right.picture, index, 1),
            self.drive.fixes[index] if self.drive.fixes else None,
        )
        vehicles = self.drive.vehicles(index) if truth else []
        bays = self.street.plan.bays
        spots = view_spots(bays, vehicles, self.camera, T_map_cam, left.ids, left.depth) if truth else []
        return SimulatedFrame(stereo, left.ids, left.depth, T_map_cam, vehicles, spots)

    @cached_property
    def _renderer(self) -> Renderer:
        street = self.street
        scene = Scene(
            street.scene.surfaces, street.scene.models, street.scene.ground, [*street.scene.things, *self.drive.still]
        )
        rng = np.random.default_rng([self.description.seed, self.description.drive, 8])
        sky = paint_sky(street.light, rng)
        around = shapely.minimum_rotated_rectangle(street.plan.asphalt.buffer(_SHADOW_MARGIN_M))
        return Renderer(
            scene,
            self.camera,
            street.light,
            self.description.effects,
            shapely.get_coordinates(around)[:4],
            sky,
            paint_surroundings(street.light, sky, rng),
            paint_lens_dirt(rng),
            self.description.light.wet,
            self._threads,
        )

    def close(self) -> None:
        """Give the renderer's memory back; the next frame asked for opens it again."""
        if "_renderer" in self.__dict__:
            self._renderer.close()
            del self.__dict__["_renderer"]
