"""A fleet of cars on a city of equal streets: diffs as a second pass makes them, cheap enough to make while sending."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
import zstandard
from numpy.typing import NDArray
from shapely.affinity import translate

from autowaze.vehicle.ground_grid import ground_that_matters
from autowaze.world import wire_pb2 as pb
from autowaze.world.column_codec import pack_integers
from autowaze.world.feature_map import MapFeatures
from autowaze.world.ground import CELL_M
from autowaze.world.identity import feature_ids
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import ParkingMap
from autowaze.world.raster_codec import BLOCK
from autowaze.world.wire import VERSION, body_of, encode_diff
from autowaze.world.wire_rows import encode_trajectory

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "cloud"))
from street import GEOREFERENCE, WINDOW_S, Street, features

STREET = Street()
SQUARE_M = BLOCK * CELL_M
BLOCK_M = 33 * SQUARE_M
"""Ground travels in squares: a grid that is moved by whole ones stays as it was packed."""
VARIANTS = 6
"""Ways in which the street's cars stand; each pass finds the next one."""
PARKED, LEFT = 10, 3
"""Vehicles in the street, and how many of them are others at the next pass."""
STATIC_FEATURES = 20
"""Features of walls and signs that a pass adds and the next one takes out again, with descriptors."""


def offset_m(block: int, blocks: int) -> tuple[float, float]:
    """East and north of a block in a square city around the origin, metres; whole squares of ground."""
    side = int(np.ceil(np.sqrt(blocks)))
    return (block % side - side // 2) * BLOCK_M, (block // side - side // 2) * BLOCK_M


def city_spots(blocks: int) -> ParkingMap:
    """The street copied to every block."""
    own = STREET.parking_map.spots
    spots = [
        replace(spot, id=f"{block}/{spot.id}", polygon=translate(spot.polygon, *offset_m(block, blocks)))
        for block in range(blocks)
        for spot in own
    ]
    return ParkingMap(tuple(spots), GEOREFERENCE)


@dataclass
class _Window:
    """One window of one pass, at the origin."""

    message: pb.SemanticMapDiff
    diff: SemanticMapDiff


class Fleet:
    """Cars that drive round and round their blocks.

    Args:
        cars: each has a block and a session of its own.
        blocks: of the city.
    """

    def __init__(self, cars: int, blocks: int, first_session: int = 1) -> None:
        self.cars = cars
        self._blocks = blocks
        self._first_session = first_session
        self._passes = _passes()
        self._compressor = zstandard.ZstdCompressor(level=3)

    @property
    def windows(self) -> int:
        """Diffs of a car for one round of its block."""
        return len(self._passes[0])

    def payload(self, car: int, sequence: int, end: float) -> bytes:
        """The diff that a car hands in as its next, of a window that ends then (seconds since the epoch)."""
        window = self._window(car, sequence)
        message = pb.SemanticMapDiff()
        message.CopyFrom(window.message)
        message.session, message.sequence = self._first_session + car, sequence
        message.start, message.end = end - WINDOW_S, end
        self._move(message, window.diff, *offset_m(car % self._blocks, self._blocks))
        removed = self._removed(car, sequence - self.windows)
        message.removed_count, message.removed = len(removed), pack_integers(removed.astype(np.int64), delta=True)
        body = self._compressor.compress(message.SerializeToString())
        return pb.Envelope(version=VERSION, body=body).SerializeToString()

    def _move(self, message: pb.SemanticMapDiff, diff: SemanticMapDiff, east: float, north: float) -> None:
        message.new.x = pack_integers(np.round((diff.new.position[:, 0] + east) * 100), delta=True)
        message.new.y = pack_integers(np.round((diff.new.position[:, 1] + north) * 100), delta=True)
        path = replace(diff.trajectory, position=diff.trajectory.position + np.array([east, north, 0.0]))
        message.trajectory.CopyFrom(encode_trajectory(path, diff.start))
        message.ground.x += round(east / SQUARE_M)
        message.ground.y += round(north / SQUARE_M)

    def _window(self, car: int, sequence: int) -> _Window:
        """Cars are not in step: of as many as a round has windows, each is in another one."""
        driven, window = divmod(sequence + car, self.windows)
        return self._passes[driven % VARIANTS][window]

    def _removed(self, car: int, sequence: int) -> NDArray[np.uint64]:
        """What the car's last pass added, so that the map stays as large as it is."""
        if sequence < 0:
            return np.zeros(0, np.uint64)
        return feature_ids(self._first_session + car, sequence, len(self._window(car, sequence).diff.new))


def _passes() -> list[list[_Window]]:
    rng = np.random.default_rng(0)
    parked = rng.choice(STREET.count, PARKED, replace=False).tolist()
    passes = []
    for variant in range(VARIANTS):
        free = [spot for spot in range(STREET.count) if spot not in parked]
        arrived = rng.choice(free, LEFT, replace=False).tolist()
        parked = parked[LEFT:] + arrived
        diffs = STREET.drive(STREET.park(parked, variant), seed=variant)
        numbers = [n for n, spot in enumerate(parked, start=1) if spot in arrived]
        passes.append([_window(diff, numbers, rng) for diff in diffs])
    return passes


def _window(diff: SemanticMapDiff, arrived: list[int], rng: np.random.Generator) -> _Window:
    """Only the vehicles that arrived are new to a car that carries the map."""
    kept = diff.new[np.isin(diff.new.instance_key & np.uint64((1 << 24) - 1), arrived)]
    # A car knows the parking map and tells of the ground there alone.
    at_spots = shapely.contains_xy(ground_that_matters(STREET.parking_map), *diff.ground.centre.T)
    ground = diff.ground[np.asarray(at_spots)]
    new = MapFeatures.concatenate([kept, _static_features(diff, rng)])
    new.id = feature_ids(diff.session, diff.sequence, len(new))
    instances = diff.instances[np.isin(diff.instances.id, arrived)]
    second_pass = replace(diff, new=new, instances=instances, ground=ground)
    return _Window(pb.SemanticMapDiff.FromString(body_of(encode_diff(second_pass))), second_pass)


def _static_features(diff: SemanticMapDiff, rng: np.random.Generator) -> MapFeatures:
    position = np.append(STREET.along * STREET.length / 2, 2.0) + rng.normal(0, 10.0, (STATIC_FEATURES, 3))
    static = features(diff.session, diff.sequence, position, [np.zeros(STATIC_FEATURES, int)], diff.start)
    static.label[:] = 0
    static.descriptor = rng.integers(1, 256, static.descriptor.shape, dtype=np.uint8)
    static.normal[:] = [0.0, 0.0, 1.0]
    return static
