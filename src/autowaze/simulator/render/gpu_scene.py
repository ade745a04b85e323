"""A scene in GPU memory: vertex buffers, textures, and which of them a camera can see."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.mesh import Mesh
from autowaze.simulator.scene import Model, Scene, Surface, Thing

_CELL_M = 18.0
_FINE_TO_M = 48.0
_IDENTITY = np.eye(4)


@dataclass(frozen=True)
class Batch:
    """One draw call's worth of triangles.

    Attributes:
        shaded, shadow: vertex arrays for the picture and the shadow map.
        centre, radius: bounding sphere in the batch's own frame.
    """

    surface: str
    shaded: Any
    shadow: Any
    centre: NDArray[np.float64]
    radius: float


@dataclass(frozen=True)
class Draw:
    """A batch at a place."""

    batch: Batch
    thing_to_map: NDArray[np.float64]
    tint: tuple[int, int, int] = (255, 255, 255)
    id: int = 0
    from_m: float = 0.0
    to_m: float = np.inf

    @cached_property
    def matrix_bytes(self) -> bytes:
        """`thing_to_map` as OpenGL wants it."""
        return column_major(self.thing_to_map)

    @cached_property
    def tint_share(self) -> tuple[float, float, float]:
        """The tint from 0 to 1."""
        r, g, b = self.tint
        return r / 255, g / 255, b / 255


class GpuScene:
    """Uploads a scene once; afterwards only poses change."""

    def __init__(self, context: Any, scene: Scene, programs: dict[str, Any], shadow_program: Any) -> None:
        self._context, self._programs, self._shadow_program = context, programs, shadow_program
        self.surfaces = scene.surfaces
        self.textures = {name: self._upload_texture(surface) for name, surface in scene.surfaces.items()}
        self._models = {name: self._upload_model(model) for name, model in scene.models.items()}
        self._far_from = {name: model.far_from_m for name, model in scene.models.items() if model.far}
        things = [draw for thing in scene.things for draw in self.draws_of(thing)]
        self.still = DrawList(self._ground_draws(scene) + things, scene.surfaces)

    def draws_of(self, thing: Thing) -> list[Draw]:
        """What to draw for one thing, near and far versions."""
        near, far = self._models[thing.model]
        split = self._far_from.get(thing.model, np.inf)
        draws = [Draw(b, thing.T_map_thing, thing.tint, thing.id, 0.0, split) for b in near]
        return draws + [Draw(b, thing.T_map_thing, thing.tint, thing.id, split, np.inf) for b in far]

    def _ground_draws(self, scene: Scene) -> list[Draw]:
        cells: dict[tuple[str, bool, int, int], list[Mesh]] = {}
        for mesh, surface, fine in scene.ground:
            middle = mesh.position[mesh.faces].mean(axis=1)
            cell = np.floor(middle[:, :2] / _CELL_M).astype(int)
            for x, y in np.unique(cell, axis=0):
                part = mesh.select((cell == (x, y)).all(axis=1))
                cells.setdefault((surface, fine, int(x), int(y)), []).append(part)
        return [
            Draw(self._upload(Mesh.concatenate(parts), key[0]), _IDENTITY, to_m=_FINE_TO_M if key[1] else np.inf)
            for key, parts in sorted(cells.items(), key=lambda item: item[0])
        ]

    def _upload_model(self, model: Model) -> tuple[list[Batch], list[Batch]]:
        near = [self._upload(mesh, surface) for mesh, surface in model.near]
        return near, [self._upload(mesh, surface) for mesh, surface in model.far or ()]

    def _upload(self, mesh: Mesh, surface: str) -> Batch:
        vertices = np.zeros(len(mesh.position), dtype=[("p", "f4", 3), ("n", "f4", 3), ("t", "f4", 2), ("c", "u1", 4)])
        vertices["p"], vertices["n"], vertices["t"], vertices["c"] = mesh.position, mesh.normal, mesh.uv, mesh.tint
        vertex_buffer = self._context.buffer(vertices.tobytes())
        index_buffer = self._context.buffer(mesh.faces.tobytes())
        program = self._programs[program_kind(self.surfaces[surface])]
        shaded = self._context.vertex_array(
            program, [(vertex_buffer, "3f 3f 2f 4f1", "in_position", "in_normal", "in_uv", "in_tint")], index_buffer
        )
        shadow = self._context.vertex_array(
            self._shadow_program, [(vertex_buffer, "3f 3x4 2f 4x1", "in_position", "in_uv")], index_buffer
        )
        low, high = mesh.position.min(axis=0), mesh.position.max(axis=0)
        return Batch(
            surface, shaded, shadow, ((low + high) / 2).astype(np.float64), float(np.linalg.norm(high - low) / 2)
        )

    def _upload_texture(self, surface: Surface) -> Any:
        import moderngl

        texture = self._context.texture(
            surface.texture.shape[1::-1], 4, np.ascontiguousarray(surface.texture).tobytes()
        )
        texture.build_mipmaps()
        texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        return texture


class DrawList:
    """Draws with their bounding spheres in map metres."""

    def __init__(self, draws: list[Draw], surfaces: dict[str, Surface]) -> None:
        self.draws = draws
        self._underfoot = np.array([surfaces[d.batch.surface].underfoot for d in draws], dtype=bool)
        centres = [d.thing_to_map[:3, :3] @ d.batch.centre + d.thing_to_map[:3, 3] for d in draws]
        self._centre = np.array(centres).reshape(-1, 3)
        self._radius = np.array([d.batch.radius * np.linalg.norm(d.thing_to_map[:3, 0]) for d in draws])
        self._from = np.array([d.from_m for d in draws])
        self._to = np.array([d.to_m for d in draws])

    def visible(self, map_to_clip: NDArray[np.float64], eye: NDArray[np.float64]) -> list[Draw]:
        """Draws that a camera may see: nearest first, but the ground last, for most of it is hidden."""
        if not self.draws:
            return []
        w, x, y = map_to_clip[3], map_to_clip[0], map_to_clip[1]
        planes = np.stack([w + x, w - x, w + y, w - y, w])
        planes = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        inside = (self._centre @ planes[:, :3].T + planes[:, 3] > -self._radius[:, None]).all(axis=1)
        distance = np.linalg.norm(self._centre - eye, axis=1)
        keep = np.flatnonzero(inside & (distance >= self._from) & (distance < self._to))
        order = np.lexsort((distance[keep] - 0.5 * self._radius[keep], self._underfoot[keep]))
        return [self.draws[i] for i in keep[order]]

    def casters(self) -> list[Draw]:
        """Draws that throw shadows: the near version of everything that is no decal."""
        return [d for d in self.draws if d.from_m == 0.0]


def column_major(matrix: NDArray[np.floating]) -> bytes:
    """Bytes of a matrix as OpenGL wants them."""
    return np.ascontiguousarray(matrix.T, np.float32).tobytes()


def program_kind(surface: Surface) -> str:
    """Which shader variant draws a surface."""
    return "DECAL" if surface.decal else "CUTOUT" if surface.cutout else "OPAQUE"
