"""Triangle meshes as numpy arrays, and the simple solids that everything is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

WHITE = (255, 255, 255, 255)


@dataclass(frozen=True)
class Mesh:
    """Triangles, counter-clockwise from outside.

    Attributes:
        position: (N, 3) float32, metres.
        normal: (N, 3) float32, unit length.
        uv: (N, 2) float32, texture coordinates; v grows downwards in the picture.
        tint: (N, 4) uint8, colour that multiplies tintable texels, and ambient light that reaches the vertex.
        faces: (M, 3) int32.
    """

    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    uv: NDArray[np.float32]
    tint: NDArray[np.uint8]
    faces: NDArray[np.int32]

    @classmethod
    def of(
        cls,
        position: ArrayLike,
        normal: ArrayLike,
        uv: ArrayLike,
        faces: ArrayLike,
        tint: ArrayLike = WHITE,
    ) -> Mesh:
        """Mesh of anything array-like; one tint for all vertices or one each."""
        positions = np.asarray(position, np.float32).reshape(-1, 3)
        tints = np.broadcast_to(np.asarray(tint, np.uint8), (len(positions), 4))
        return cls(
            positions,
            np.broadcast_to(np.asarray(normal, np.float32), positions.shape).copy(),
            np.broadcast_to(np.asarray(uv, np.float32), (len(positions), 2)).copy(),
            tints.copy(),
            np.asarray(faces, np.int32).reshape(-1, 3),
        )

    @classmethod
    def empty(cls) -> Mesh:
        """No triangle at all."""
        return cls.of(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 3)))

    @classmethod
    def concatenate(cls, parts: Sequence[Mesh]) -> Mesh:
        """All triangles of the parts."""
        if not parts:
            return cls.empty()
        offsets = np.cumsum([0] + [len(part.position) for part in parts[:-1]])
        return cls(
            np.concatenate([part.position for part in parts]),
            np.concatenate([part.normal for part in parts]),
            np.concatenate([part.uv for part in parts]),
            np.concatenate([part.tint for part in parts]),
            np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)]).astype(np.int32),
        )

    def __len__(self) -> int:
        return len(self.faces)

    def moved(self, T: NDArray[np.floating]) -> Mesh:
        """Taken through a 4 x 4 rigid transform."""
        position = self.position @ T[:3, :3].T + T[:3, 3]
        return replace(
            self, position=position.astype(np.float32), normal=(self.normal @ T[:3, :3].T).astype(np.float32)
        )

    def scaled(self, factors: ArrayLike) -> Mesh:
        """Stretched about the origin by one factor, or one per axis."""
        factors = np.broadcast_to(np.asarray(factors, np.float64), (3,))
        normal = self.normal / factors
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        return replace(self, position=(self.position * factors).astype(np.float32), normal=normal.astype(np.float32))

    def select(self, faces: NDArray[np.bool_]) -> Mesh:
        """Only some of the triangles, with the vertices they need."""
        used, inverse = np.unique(self.faces[faces], return_inverse=True)
        return Mesh(
            self.position[used],
            self.normal[used],
            self.uv[used],
            self.tint[used],
            inverse.reshape(-1, 3).astype(np.int32),
        )


def grid_faces(rows: int, columns: int) -> NDArray[np.int32]:
    """Triangles of a grid of rows x columns vertices, numbered row by row."""
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def vertex_normals(position: NDArray[np.floating], faces: NDArray[np.integer]) -> NDArray[np.float64]:
    """Area-weighted normals (N, 3) of the vertices of smooth triangles."""
    corners = position[faces].astype(np.float64)
    face_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros((len(position), 3))
    for corner in range(3):
        np.add.at(normals, faces[:, corner], face_normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return normals


def quads(corners: ArrayLike, uv: ArrayLike, tint: ArrayLike = WHITE) -> Mesh:
    """Flat quadrilaterals (Q, 4, 3), corners counter-clockwise from outside, with texture coordinates (Q, 4, 2)."""
    corners = np.asarray(corners, np.float64).reshape(-1, 4, 3)
    uvs = np.broadcast_to(np.asarray(uv, np.float64), (len(corners), 4, 2))
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    first = 4 * np.arange(len(corners))[:, None, None]
    faces = first + np.array([[0, 1, 2], [0, 2, 3]])
    tints = np.asarray(tint, np.uint8)
    tints = np.repeat(tints, 4, axis=0) if tints.ndim == 2 else tints
    return Mesh.of(corners.reshape(-1, 3), np.repeat(normals, 4, axis=0), uvs.reshape(-1, 2), faces, tints)


def box(low: ArrayLike, high: ArrayLike, texture_m: float = 1.0, tint: ArrayLike = WHITE, bottom: bool = True) -> Mesh:
    """Axis-aligned box between two corners; one texture repeat per `texture_m` metres."""
    x0, y0, z0 = np.asarray(low, np.float64)
    x1, y1, z1 = np.asarray(high, np.float64)
    faces = [
        [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)],
        [(x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1)],
        [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
        [(x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1)],
        [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
        [(x0, y1, z0), (x1, y1, z0), (x1, y0, z0), (x0, y0, z0)],
    ]
    sizes = [(x1 - x0, z1 - z0)] * 2 + [(y1 - y0, z1 - z0)] * 2 + [(x1 - x0, y1 - y0)] * 2
    uv = [[(0, -h), (w, -h), (w, 0), (0, 0)] for w, h in sizes]
    count = 6 if bottom else 5
    return quads(faces[:count], np.array(uv[:count]) / texture_m, tint)


def revolved(
    radius: ArrayLike,
    height: ArrayLike,
    sides: int = 12,
    repeat: tuple[float, float] = (1.0, 1.0),
    tint: ArrayLike = WHITE,
) -> Mesh:
    """Surface of revolution about z: radii at rising heights; the texture repeats around and along."""
    radii, heights = np.asarray(radius, np.float64), np.asarray(height, np.float64)
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    position = np.concatenate(
        [radii[:, None, None] * ring, np.broadcast_to(heights[:, None, None], (len(radii), sides + 1, 1))], -1
    )
    dr, dz = np.gradient(radii), np.gradient(heights)
    length = np.maximum(np.hypot(dr, dz), 1e-12)
    normal = np.concatenate(
        [
            (dz / length)[:, None, None] * ring,
            np.broadcast_to((-dr / length)[:, None, None], (len(radii), sides + 1, 1)),
        ],
        -1,
    )
    along = np.linspace(0.0, repeat[1], len(radii))
    uv = np.stack(np.broadcast_arrays(angle[None] / (2 * np.pi) * repeat[0], -along[:, None]), -1)
    faces = grid_faces(len(radii), sides + 1)[:, ::-1]
    return Mesh.of(position.reshape(-1, 3), normal.reshape(-1, 3), uv.reshape(-1, 2), faces, tint)


def tube(
    start: ArrayLike,
    end: ArrayLike,
    radius: float,
    end_radius: float | None = None,
    sides: int = 8,
    tint: ArrayLike = WHITE,
) -> Mesh:
    """Open tube between two points."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    length = float(np.linalg.norm(b - a))
    mesh = revolved([radius, radius if end_radius is None else end_radius], [0.0, length], sides, (1.0, length), tint)
    return mesh.moved(aligned_with(a, b - a))


def ellipsoid(centre: ArrayLike, radii: ArrayLike, sides: int = 10, rings: int = 7, tint: ArrayLike = WHITE) -> Mesh:
    """Ellipsoid with half-axes along x, y, z."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rings)
    unit = revolved(np.cos(latitude), np.sin(latitude), sides, tint=tint)
    normal = unit.position / np.maximum(np.linalg.norm(unit.position, axis=1, keepdims=True), 1e-9)
    shaped = replace(unit, normal=normal).scaled(radii)
    T = np.eye(4)
    T[:3, 3] = np.asarray(centre, np.float64)
    return shaped.moved(T)


def shifted(point: ArrayLike, x: float, y: float, z: float) -> NDArray[np.float64]:
    """A point (3,) moved."""
    return np.asarray(np.asarray(point, np.float64) + np.array([x, y, z]))


def aligned_with(origin: ArrayLike, direction: ArrayLike) -> NDArray[np.float64]:
    """Transform (4, 4) that takes the z axis to a direction and the origin to a point."""
    z = np.asarray(direction, np.float64)
    z = z / np.maximum(np.linalg.norm(z), 1e-12)
    helper = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, np.cross(z, x), z, np.asarray(origin, np.float64)
    return T


def planted(x: float, y: float, z: float, heading_rad: float, scale: float = 1.0) -> NDArray[np.float64]:
    """Transform (4, 4) of a thing that stands upright: its x axis turned counter-clockwise from east."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    T = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]], dtype=np.float64)
    T[:3, :3] *= scale
    return T
