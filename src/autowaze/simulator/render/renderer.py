"""From a scene and a camera pose to a picture, instance ids and depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.description import Effects
from autowaze.simulator.light import Illumination
from autowaze.simulator.render.gl import build_program, open_context
from autowaze.simulator.render.gpu_scene import Draw, DrawList, GpuScene, column_major, program_kind
from autowaze.simulator.render.shadow_map import ShadowMap, sun_projection
from autowaze.simulator.scene import Scene, Thing
from autowaze.world.camera import StereoCamera
from autowaze.world.frame import Image
from autowaze.world.pose import Pose, inverse, make_pose

NEAR_M, FAR_M = 0.3, 400.0
_SKY_DEPTH = 0.99998
_STATIC_SHADOW_TEXELS, _MOVING_SHADOW_TEXELS = 4096, 1024
_MOVING_SHADOW_REACH_M = 32.0


@dataclass(frozen=True)
class Rendering:
    """What one camera sees.

    Attributes:
        picture: (H, W, 3) uint8 BGR.
        ids: (H, W) uint32 instance ids, 0 for everything that does not come and go.
        depth: (H, W) float32 metres along the optical axis; infinite in the sky.
    """

    picture: Image
    ids: NDArray[np.uint32]
    depth: NDArray[np.float32]


class Renderer:
    """Draws one scene with one camera in one light; open it in the process and thread that uses it."""

    def __init__(
        self,
        scene: Scene,
        camera: StereoCamera,
        light: Illumination,
        effects: Effects,
        shadow_ground: NDArray[np.float64],
        sky: NDArray[np.uint8],
        surroundings: NDArray[np.uint8],
        dirt: NDArray[np.uint8],
        wet: bool = False,
        threads: int | None = None,
    ) -> None:
        import moderngl

        self._gl = moderngl
        self.context = open_context(threads)
        self.context.enable(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self.context.depth_func = "<="
        self._camera, self._light, self._effects, self._wet = camera, light, effects, wet
        self._programs = {
            k: build_program(self.context, "surface.vert", "surface.frag", k) for k in ("OPAQUE", "CUTOUT", "DECAL")
        }
        shadow_program = build_program(self.context, "shadow.vert", "shadow.frag")
        self._sky_program = build_program(self.context, "screen.vert", "sky.frag")
        self._lens_program = build_program(self.context, "screen.vert", "lens.frag")
        self.scene = GpuScene(self.context, scene, self._programs, shadow_program)
        self._shadow = ShadowMap(self.context, shadow_program, _STATIC_SHADOW_TEXELS)
        self._moving_shadow = ShadowMap(self.context, shadow_program, _MOVING_SHADOW_TEXELS)
        if max(light.sun) > 0:
            projection = sun_projection(light.to_sun, shadow_ground, 8.0)
            self._shadow.draw(self.scene, self.scene.still.casters(), projection)
        pictures = {"sky_picture": sky, "surroundings": surroundings, "dirt": dirt}
        self._pictures = {name: self._picture(image) for name, image in pictures.items()}
        self._sky_quad = self.context.vertex_array(self._sky_program, [])
        self._lens_quad = self.context.vertex_array(self._lens_program, [])
        self._make_targets()
        self._set_constants()

    def _picture(self, image: NDArray[np.uint8]) -> Any:
        texture = self.context.texture(image.shape[1::-1], 4, np.ascontiguousarray(image).tobytes())
        texture.build_mipmaps()
        texture.filter = (self._gl.LINEAR_MIPMAP_LINEAR, self._gl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture

    def _make_targets(self) -> None:
        size = (self._camera.width, self._camera.height)
        self._colour = self.context.texture(size, 4)
        self._colour.repeat_x = self._colour.repeat_y = False
        self._ids = self.context.texture(size, 1, dtype="u4")
        self._ids.filter = (self._gl.NEAREST, self._gl.NEAREST)
        self._depth = self.context.depth_texture(size)
        self._depth.compare_func = ""
        self._depth.filter = (self._gl.NEAREST, self._gl.NEAREST)
        self._target = self.context.framebuffer([self._colour, self._ids], self._depth)
        self._screen = self.context.simple_framebuffer(size, 4)

    def _set_constants(self) -> None:
        light = self._light
        for program in self._programs.values():
            _set(program, "surface", 0)
            _set(program, "static_shadow", 1)
            _set(program, "moving_shadow", 2)
            _set(program, "surroundings", 3)
            _set(program, "to_sun", tuple(float(v) for v in light.to_sun))
            for name in ("sun", "sky", "ground", "haze", "haze_per_m", "exposure"):
                _set(program, name, getattr(light, name))
            _set(program, "sun_on", float(max(light.sun) > 0))
            if "map_to_sun" in program:
                program["map_to_sun"].write(column_major(self._shadow.map_to_sun))
        _set(self._sky_program, "sky_picture", 0)
        _set(self._sky_program, "exposure", light.exposure)
        lens, effects = self._lens_program, self._effects
        for slot, name in enumerate(("picture", "depth", "dirt")):
            _set(lens, name, slot)
        _set(lens, "texel", (1.0 / self._camera.width, 1.0 / self._camera.height))
        _set(lens, "vignetting", effects.vignetting)
        _set(lens, "dirt_amount", effects.lens_dirt)

    def place_moving(self, things: list[Thing], around: NDArray[np.float64]) -> None:
        """Say what moves in the coming renderings, and where (2,) the ego vehicle is."""
        draws = [draw for thing in things for draw in self.scene.draws_of(thing)]
        self._moving = DrawList(draws, self.scene.surfaces)
        on = max(self._light.sun) > 0 and bool(things)
        if on:
            reach = _MOVING_SHADOW_REACH_M
            corners = around + reach * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
            self._moving_shadow.draw(
                self.scene, self._moving.casters(), sun_projection(self._light.to_sun, corners, 3.0, 5.0)
            )
        for program in self._programs.values():
            _set(program, "moving_shadow_on", float(on))
            if "map_to_moving_sun" in program:
                program["map_to_moving_sun"].write(column_major(self._moving_shadow.map_to_sun))

    def render(self, T_map_cam: Pose, T_map_cam_before: Pose | None = None, truth: bool = True) -> Rendering:
        """Draw one picture.

        Args:
            T_map_cam: pose of the camera.
            T_map_cam_before: pose at the start of the exposure, for motion blur.
            truth: whether to read ids and depth back; without, they are empty.
        """
        map_to_clip = clip_from_camera(self._camera) @ inverse(T_map_cam)
        eye = T_map_cam[:3, 3]
        self._target.use()
        self._target.clear()
        self._shadow.depth.use(1)
        self._moving_shadow.depth.use(2)
        self._pictures["surroundings"].use(3)
        for program in self._programs.values():
            program["map_to_clip"].write(column_major(map_to_clip))
            _set(program, "eye", tuple(float(v) for v in eye))
        draws = self.scene.still.visible(map_to_clip, eye) + self._moving.visible(map_to_clip, eye)
        for kind in ("OPAQUE", "CUTOUT"):
            self._draw(kind, draws)
        self._draw_sky(T_map_cam)
        self._target.depth_mask = False
        self.context.enable(self._gl.BLEND)
        self._draw("DECAL", draws)
        self.context.disable(self._gl.BLEND)
        self._target.depth_mask = True
        picture = self._through_lens(T_map_cam, T_map_cam_before)
        if not truth:
            return Rendering(picture, np.zeros((0, 0), np.uint32), np.zeros((0, 0), np.float32))
        shape = (self._camera.height, self._camera.width)
        ids = np.frombuffer(self._ids.read(), np.uint32).reshape(shape)[::-1].copy()
        z = np.frombuffer(self._depth.read(), np.float32).reshape(shape)[::-1]
        return Rendering(picture, ids, metres_from_depth(z))

    def _draw(self, kind: str, draws: list[Draw]) -> None:
        program = self._programs[kind]
        to_map, tint, instance = (program.get(n, None) for n in ("thing_to_map", "thing_tint", "instance_id"))
        if kind == "CUTOUT":
            self.context.disable(self._gl.CULL_FACE)
        last, matrix, colour, id = "", b"", (-1.0, -1.0, -1.0), -1
        for draw in draws:
            name = draw.batch.surface
            surface = self.scene.surfaces[name]
            if program_kind(surface) != kind:
                continue
            if name != last:
                self.scene.textures[name].use(0)
                _set(program, "gloss", surface.gloss)
                _set(program, "glow", surface.glow)
                _set(program, "wetness", float(self._wet and surface.wettable))
                last = name
            if draw.matrix_bytes != matrix:
                matrix = draw.matrix_bytes
                to_map.write(matrix)
            if draw.tint_share != colour:
                colour = draw.tint_share
                tint.value = colour
            if draw.id != id:
                id = draw.id
                instance.value = id
            draw.batch.shaded.render()
        self.context.enable(self._gl.CULL_FACE)

    def _draw_sky(self, T_map_cam: Pose) -> None:
        camera = self._camera
        # from 0..1 across the screen (bottom up) to a ray in the camera, to the map
        ray = np.array(
            [
                [camera.width / camera.fx, 0.0, -(camera.cx + 0.5) / camera.fx],
                [0.0, -camera.height / camera.fy, (camera.height - camera.cy - 0.5) / camera.fy],
                [0.0, 0.0, 1.0],
            ]
        )
        self._sky_program["screen_to_map"].write(column_major(T_map_cam[:3, :3] @ ray))
        self._pictures["sky_picture"].use(0)
        self.context.disable(self._gl.CULL_FACE)
        self._sky_quad.render(vertices=3)
        self.context.enable(self._gl.CULL_FACE)

    def _through_lens(self, T_map_cam: Pose, before: Pose | None) -> Image:
        lens = self._lens_program
        _set(lens, "blur_on", float(before is not None))
        if before is not None:
            project = clip_from_camera(self._camera)
            then = project @ inverse(before) @ T_map_cam @ np.linalg.inv(project)
            lens["clip_to_exposure_start"].write(column_major(then))
        self._screen.use()
        self.context.disable(self._gl.DEPTH_TEST | self._gl.CULL_FACE)
        self._colour.use(0)
        self._depth.use(1)
        self._pictures["dirt"].use(2)
        self._lens_quad.render(vertices=3)
        self.context.enable(self._gl.DEPTH_TEST | self._gl.CULL_FACE)
        shape = (self._camera.height, self._camera.width, 4)
        read = np.frombuffer(self._screen.read(components=4), np.uint8).reshape(shape)
        return np.asarray(cv2.cvtColor(read, cv2.COLOR_BGRA2BGR), np.uint8)

    def close(self) -> None:
        """Give the GPU memory back."""
        self.context.release()


def clip_from_camera(camera: StereoCamera) -> NDArray[np.float64]:
    """Projection (4, 4) from the camera frame (x right, y down, z forward) to clip space.

    Pixel centres have integer coordinates, as in `StereoCamera`.
    """
    a, b = (FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2 * FAR_M * NEAR_M / (FAR_M - NEAR_M)
    w, h = camera.width, camera.height
    return np.array(
        [
            [2 * camera.fx / w, 0.0, 2 * (camera.cx + 0.5) / w - 1, 0.0],
            [0.0, -2 * camera.fy / h, 1 - 2 * (camera.cy + 0.5) / h, 0.0],
            [0.0, 0.0, a, b],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )


def metres_from_depth(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Distance along the optical axis from depth-buffer values; infinite where nothing was drawn."""
    ndc = 2.0 * depth.astype(np.float32) - 1.0
    metres = 2 * FAR_M * NEAR_M / (FAR_M + NEAR_M - ndc * (FAR_M - NEAR_M))
    metres[depth > _SKY_DEPTH] = np.inf
    return np.asarray(metres, np.float32)


def right_camera(T_map_left: Pose, baseline_m: float, wobble: NDArray[np.float64]) -> Pose:
    """Pose of the right camera; `wobble` (3, 3) is the rotation that rectification left over."""
    return T_map_left @ make_pose(wobble, np.array([baseline_m, 0.0, 0.0]))


def _set(program: Any, name: str, value: Any) -> None:
    """Set a uniform that the compiler may have found unused."""
    uniform = program.get(name, None)
    if uniform is not None:
        uniform.value = value
