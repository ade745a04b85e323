"""Shadow maps: one of everything that stands still, drawn once, and one of what moves, drawn each frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.render.gpu_scene import Draw, GpuScene, column_major


class ShadowMap:
    """Depth as the sun sees it."""

    def __init__(self, context: Any, program: Any, size: int) -> None:
        import moderngl

        self._context, self._program = context, program
        self.size = size
        self.depth = context.depth_texture((size, size))
        self.depth.compare_func = "<="
        self.depth.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.depth.repeat_x = self.depth.repeat_y = False
        self._framebuffer = context.framebuffer([], self.depth)
        self.map_to_sun = np.eye(4)

    def draw(self, scene: GpuScene, draws: list[Draw], map_to_sun: NDArray[np.float64]) -> None:
        """Draw the casters."""
        import moderngl

        self.map_to_sun = map_to_sun
        self._framebuffer.use()
        self._framebuffer.clear(depth=1.0)
        self._context.disable(moderngl.CULL_FACE)
        self._program["map_to_clip"].write(column_major(map_to_sun))
        for draw in draws:
            surface = scene.surfaces[draw.batch.surface]
            if surface.decal:
                continue
            self._program["cutout"].value = float(surface.cutout)
            if surface.cutout:
                scene.textures[draw.batch.surface].use(0)
            self._program["thing_to_map"].write(draw.matrix_bytes)
            draw.batch.shadow.render()
        self._context.enable(moderngl.CULL_FACE)


def sun_projection(
    to_sun: NDArray[np.float64], corners: NDArray[np.float64], height_m: float, reach_up_m: float = 30.0
) -> NDArray[np.float64]:
    """Orthographic projection (4, 4) along the sun's rays onto a patch of ground.

    Args:
        corners: (N, 2) map metres that the shadow map must cover.
        height_m: how high shadows may fall, on walls for instance.
        reach_up_m: height of the tallest caster.
    """
    z = to_sun / np.linalg.norm(to_sun)
    x = np.cross([0.0, 0.0, 1.0], z)
    x = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(x) < 1e-6 else x / np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    low = np.column_stack([corners, np.zeros(len(corners))])
    high = np.column_stack([corners, np.full(len(corners), height_m)])
    covered = np.concatenate([low, high]) @ R.T
    a, b = covered.min(axis=0), covered.max(axis=0)
    near = b[2] + reach_up_m / max(z[2], 0.12)
    far = a[2] - 1.0
    T = np.eye(4)
    scale = 2.0 / (b[:2] - a[:2])
    T[0, :3], T[0, 3] = scale[0] * R[0], -scale[0] * (a[0] + b[0]) / 2
    T[1, :3], T[1, 3] = scale[1] * R[1], -scale[1] * (a[1] + b[1]) / 2
    depth = 2.0 / (near - far)
    T[2, :3], T[2, 3] = -depth * R[2], depth * (near + far) / 2
    return T
