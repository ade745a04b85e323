"""Trees with leaves, and hedges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.mesh import Mesh, grid_faces, tube, vertex_normals
from autowaze.simulator.scene import Model

TREE_SHAPES = 5


def tree(rng: np.random.Generator) -> Model:
    """A street tree of about 7 m: trunk, limbs, and a crown of leaf clusters."""
    trunk_m, crown_m = float(rng.uniform(2.2, 3.0)), float(rng.uniform(1.5, 2.3))
    height = trunk_m + crown_m * float(rng.uniform(1.1, 1.5))
    lean = rng.normal(0, 0.12, 2)
    fork = np.array([*lean, trunk_m])
    wood = [tube((0, 0, 0), fork, 0.17, 0.12, 9), tube(fork, (*(lean * 1.6), height), 0.12, 0.03, 7)]
    clumps = []
    for i in range(int(rng.integers(5, 8))):
        angle = 2.4 * i + rng.normal(0, 0.3)
        out = crown_m * float(rng.uniform(0.45, 0.75))
        tip = np.array([out * np.cos(angle), out * np.sin(angle), height * float(rng.uniform(0.72, 1.0))])
        wood.append(tube(fork * [1, 1, float(rng.uniform(0.85, 1.05))], tip, 0.075, 0.02, 6))
        clumps.append((tip, crown_m * float(rng.uniform(0.40, 0.62))))
    clumps.append((np.array([*lean, height + 0.2]), crown_m * 0.6))
    trunk = Mesh.concatenate(wood)
    near, far = (
        ((trunk, "bark"), (_crown(clumps, rng), "leaves")),
        ((trunk, "bark"), (_crown(clumps, rng, 0.35), "leaves")),
    )
    return Model(near, far, far_from_m=34.0)


def _crown(clumps: list[tuple[NDArray[np.float64], float]], rng: np.random.Generator, share: float = 1.0) -> Mesh:
    """Leaf clusters on cards, turned every way, brighter outside than inside; fewer and larger for a smaller share."""
    middle = np.mean([c for c, _ in clumps], axis=0)
    positions, normals, uvs, tints = [], [], [], []
    for centre, radius in clumps:
        count = int(20 * share * radius / 0.8)
        direction = rng.normal(size=(count, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        at = centre + direction * radius * rng.uniform(0.55, 1.0, (count, 1)) * [1.0, 1.0, 0.8]
        for point, outwards in zip(at, direction, strict=True):
            a = np.cross(outwards + 0.7 * rng.normal(size=3), rng.normal(size=3))
            a /= np.linalg.norm(a)
            b = np.cross(outwards, a) + 0.3 * rng.normal(size=3)
            b -= (b @ a) * a
            b /= np.linalg.norm(b)
            half = float(rng.uniform(0.34, 0.52)) / share**0.4
            positions.append(
                [
                    point - half * a - half * b,
                    point + half * a - half * b,
                    point + half * a + half * b,
                    point - half * a + half * b,
                ]
            )
            soft = point - middle
            soft = soft / max(float(np.linalg.norm(soft)), 1e-6) + [0, 0, 0.25]
            normals.append([soft / np.linalg.norm(soft)] * 4)
            uvs.append([(0, 1), (1, 1), (1, 0), (0, 0)])
            shade = float(
                np.clip(0.45 + 0.32 * np.linalg.norm(point - middle) + 0.12 * (point[2] - middle[2]), 0.35, 1.0)
            )
            tone = float(rng.uniform(0.85, 1.0))
            tints.append([(int(255 * tone), int(255 * tone), int(245 * tone), int(255 * shade))] * 4)
    first = 4 * np.arange(len(positions))[:, None, None]
    faces = first + np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh.of(
        np.reshape(positions, (-1, 3)),
        np.reshape(normals, (-1, 3)),
        np.reshape(uvs, (-1, 2)),
        faces,
        np.reshape(tints, (-1, 4)),
    )


def hedge(x0: float, x1: float, y0: float, y1: float, height: float, rng: np.random.Generator) -> Mesh:
    """A clipped hedge along x, a little uneven."""
    length = x1 - x0
    columns = max(3, int(length / 0.35))
    profile = np.array([(0.0, 0.0), (-0.04, height * 0.5), (0.02, height * 0.92), (0.14, height), (0.5, height + 0.03),
                        (0.86, height), (0.98, height * 0.92), (1.04, height * 0.5), (1.0, 0.0)])  # fmt: skip
    x = np.broadcast_to(np.linspace(x0, x1, columns)[:, None], (columns, len(profile)))
    y = y0 + (y1 - y0) * np.broadcast_to(profile[:, 0], x.shape)
    z = np.broadcast_to(profile[:, 1], x.shape)
    bumps = rng.normal(0, 0.035, (columns, len(profile), 3)) * (z[..., None] > 0)
    position = (np.stack([x, y, z], -1) + bumps).reshape(-1, 3)
    # close the ends by drawing the outline in to its middle
    around = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile * [y1 - y0, 1.0], axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(x / 1.6, around / 1.6), -1).reshape(-1, 2)
    faces = grid_faces(columns, len(profile))
    n = len(profile)
    for start, flip in ((0, False), ((columns - 1) * n, True)):
        ring = start + np.arange(n)
        fan = np.stack([np.full(n - 2, ring[0]), ring[1:-1], ring[2:]], -1)
        faces = np.concatenate([faces, (fan[:, ::-1] if flip else fan).astype(np.int32)])
    normals = vertex_normals(position, faces)
    light = np.clip(0.45 + 0.55 * position[:, 2] / height, 0, 1)
    tint = np.full((len(position), 4), 255, np.uint8)
    tint[:, 3] = (255 * light).astype(np.uint8)
    return Mesh.of(position, normals, uv, faces, tint)
