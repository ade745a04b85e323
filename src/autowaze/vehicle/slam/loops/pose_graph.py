"""Poses of a whole drive from what is known of pairs of them: Gauss-Newton on SE(3).

Method: Lu & Milios 1997, "Globally consistent range scan alignment for environment mapping"; Grisetti et al. 2010, "A
tutorial on graph-based SLAM"; loops are weighed down by Huber's function.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, identity
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from autowaze.world.columns import Columns
from autowaze.world.pose import inverse

_ITERATIONS = 20
_CONVERGED = 1e-6  # m and rad
_HUBER = 3.55  # the root of chi squared with 6 degrees of freedom at 95 %


@dataclass
class RelativePoses(Columns):
    """What is known of pairs of poses, E rows.

    Attributes:
        a, b: (E,) int64, numbers of the poses.
        T_a_b: (E, 4, 4), the pose of b in a.
        covariance: (E, 6, 6) of its position (m) and rotation vector (rad) in the frame of a.
        robust: (E,) bool, whether it may be wrong altogether.
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    T_a_b: NDArray[np.float64]
    covariance: NDArray[np.float64]
    robust: NDArray[np.bool_]


@dataclass(frozen=True)
class GraphSolution:
    """Poses (N, 4, 4); covariance (6, 6) of the last one against the first, in the map frame."""

    T_map_cam: NDArray[np.float64]
    covariance: NDArray[np.float64]


def optimize_graph(T_map_cam: NDArray[np.float64], known: RelativePoses) -> GraphSolution:
    """Least error over all relative poses; the first pose is held.

    With r the error of position and rotation vector of an edge in the frame of a, and L the factor of its information,

        min over T of sum of rho(|L' r|),    r = (R_a'(t_b - t_a) - t_ab, log(R_ab' R_a' R_b))

    Args:
        T_map_cam: (N, 4, 4), where to start. known: pairs that connect every pose with the first.
    """
    T = T_map_cam.copy()
    information = np.asarray(np.linalg.inv(_of_local_errors(known)), dtype=np.float64)
    for _ in range(_ITERATIONS):
        solver, right = _normal_equations(T, known, information)
        step = solver.solve(right).reshape(-1, 6)
        T[1:, :3, 3] += np.einsum("nij,nj->ni", T[1:, :3, :3], step[:, :3])
        T[1:, :3, :3] = T[1:, :3, :3] @ Rotation.from_rotvec(step[:, 3:]).as_matrix()
        if np.abs(step).max() < _CONVERGED:
            break
    unit = np.zeros((len(right), 6))
    unit[-6:] = np.eye(6)
    to_map = np.kron(np.eye(2), T[-1, :3, :3])
    return GraphSolution(T, to_map @ solver.solve(unit)[-6:] @ to_map.T)


def _of_local_errors(known: RelativePoses) -> NDArray[np.float64]:
    """Covariances with the rotation's part in the frame of b, as the errors below state it."""
    R = known.T_a_b[:, :3, :3]
    turned = np.tile(np.eye(6), (len(known), 1, 1))
    turned[:, 3:, 3:] = np.swapaxes(R, 1, 2)
    return turned @ known.covariance @ np.swapaxes(turned, 1, 2)


def _normal_equations(
    T: NDArray[np.float64], known: RelativePoses, information: NDArray[np.float64]
) -> tuple[Any, NDArray[np.float64]]:
    """Factorised information of all poses but the first, and the gradient downhill."""
    T_a_b = inverse(T[known.a]) @ T[known.b]
    r = np.empty((len(known), 6))
    r[:, :3] = T_a_b[:, :3, 3] - known.T_a_b[:, :3, 3]
    r[:, 3:] = Rotation.from_matrix(np.swapaxes(known.T_a_b[:, :3, :3], 1, 2) @ T_a_b[:, :3, :3]).as_rotvec()
    J_a, J_b = _jacobians(T_a_b, r[:, 3:])
    size = np.sqrt(np.einsum("ei,eij,ej->e", r, information, r))
    W = information * np.where(known.robust, np.minimum(1.0, _HUBER / np.maximum(size, 1e-12)), 1.0)[:, None, None]
    Ja_W, Jb_W = np.swapaxes(J_a, 1, 2) @ W, np.swapaxes(J_b, 1, 2) @ W
    n = 6 * len(T)
    gradient = np.zeros((len(T), 6))
    np.add.at(gradient, known.a, np.einsum("eij,ej->ei", Ja_W, r))
    np.add.at(gradient, known.b, np.einsum("eij,ej->ei", Jb_W, r))
    blocks = np.concatenate([Ja_W @ J_a, Ja_W @ J_b, Jb_W @ J_a, Jb_W @ J_b])
    f = np.concatenate([known.a, known.a, known.b, known.b])
    h = np.concatenate([known.a, known.b, known.a, known.b])
    row = np.broadcast_to(6 * f[:, None, None] + np.arange(6)[:, None], blocks.shape)
    column = np.broadcast_to(6 * h[:, None, None] + np.arange(6), blocks.shape)
    H = coo_matrix((blocks.ravel(), (row.ravel(), column.ravel())), shape=(n, n)).tocsc()[6:, 6:]
    solver = splu((H + 1e-9 * identity(n - 6)).tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return solver, -gradient[1:].ravel()


def _jacobians(
    T_a_b: NDArray[np.float64], omega: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of the errors (E, 6) by small motions of each camera in its own frame (E, 6, 6)."""
    R, t = T_a_b[:, :3, :3], T_a_b[:, :3, 3]
    # The inverse right Jacobian of rotations, to first order: errors of rotation are small.
    J_log = np.eye(3) + 0.5 * _skew(omega)
    J_a, J_b = np.zeros((len(R), 6, 6)), np.zeros((len(R), 6, 6))
    J_a[:, :3, :3] = -np.eye(3)
    J_a[:, :3, 3:] = _skew(t)
    J_a[:, 3:, 3:] = -J_log @ np.swapaxes(R, 1, 2)
    J_b[:, :3, :3] = R
    J_b[:, 3:, 3:] = J_log
    return J_a, J_b


def _skew(v: NDArray[np.float64]) -> NDArray[np.float64]:
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)
