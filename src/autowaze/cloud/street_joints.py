"""Where streets join, and the pieces of street between the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

REACH_M = 1.0
"""A street that ends so near to another one joins it: drawn maps are not exact."""
_SAME_M = 0.01


@dataclass(frozen=True)
class Pieces:
    """E pieces of street between J joints.

    Attributes:
        line: (E,) shapely LineStrings in map metres.
        street: (E,) int64, row of the street that it is part of.
        begin, end: (E,) int64, joints.
        joints: J.
    """

    line: NDArray[np.object_]
    street: NDArray[np.int64]
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    joints: int


def pieces_between_joints(lines: NDArray[np.object_]) -> Pieces:
    """Streets (N,) cut where they share a position; where they cross without one, one is a bridge."""
    if len(lines) == 0:
        none = np.zeros(0, np.int64)
        return Pieces(np.zeros(0, np.object_), none, none, none, 0)
    lines = _with_ends_joined(shapely.remove_repeated_points(lines, _SAME_M))
    points, street = shapely.get_coordinates(lines, return_index=True)
    vertex = _vertices(points)
    first = np.append(True, street[1:] != street[:-1])
    last = np.append(street[1:] != street[:-1], True)
    cut = np.flatnonzero(first | last | (np.bincount(vertex)[vertex] > 1))
    one, other = cut[:-1], cut[1:]
    within = street[one] == street[other]
    one, other = one[within], other[within]
    names, joint = np.unique(np.append(vertex[one], vertex[other]), return_inverse=True)
    count = other - one + 1
    piece = np.repeat(np.arange(len(one)), count)
    row = np.repeat(one, count) + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    pieces = shapely.linestrings(points[row], indices=piece)
    return Pieces(pieces, street[one], joint[: len(one)], joint[len(one) :], len(names))


def _with_ends_joined(lines: NDArray[np.object_]) -> NDArray[np.object_]:
    """The streets with a vertex wherever another one ends on them, or almost."""
    ends = np.concatenate([shapely.get_point(lines, 0), shapely.get_point(lines, -1)])
    owner = np.tile(np.arange(len(lines)), 2)
    end, line = shapely.STRtree(lines).query(ends, predicate="dwithin", distance=REACH_M)
    foreign = owner[end] != line
    end, line = end[foreign], line[foreign]
    # Those that share a vertex already join there.
    every = _vertices(np.concatenate([shapely.get_coordinates(ends), shapely.get_coordinates(lines)]))
    vertex_of_end, vertices = every[: len(ends)], every[len(ends) :]
    street = shapely.get_coordinates(lines, return_index=True)[1]
    known = np.isin(vertex_of_end[end] * len(lines) + line, vertices * len(lines) + street)
    additions: dict[int, list[shapely.Point]] = {}
    for point, row in zip(ends[end[~known]], line[~known].tolist(), strict=True):
        additions.setdefault(row, []).append(point)
    joined = lines.copy()
    for row, new in additions.items():
        joined[row] = _with_vertices(lines[row], new)
    return joined


def _with_vertices(line: shapely.LineString, new: list[shapely.Point]) -> shapely.LineString:
    points = np.concatenate([shapely.get_coordinates(line), shapely.get_coordinates(new)])
    corners = shapely.get_coordinates(line)
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T)))  # by vertex: a line may cross itself
    order = np.argsort(np.append(along, shapely.line_locate_point(line, np.array(new))), kind="stable")
    return shapely.LineString(points[order])


def _vertices(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """A number (N,) per position, the same for those that are the same to a centimetre."""
    cell = np.round(points / _SAME_M).astype(np.int64)
    return np.asarray(np.unique((cell[:, 0] << 32) + cell[:, 1], return_inverse=True)[1], dtype=np.int64)
