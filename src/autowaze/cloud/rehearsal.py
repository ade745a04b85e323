"""A service meets its first diffs before any car sends one, so that no car waits for a compiler.

Compiled loops are kept on disk, but a new machine has none yet, and a process has to load them: seconds in which the
first diffs of a fleet would pile up.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import shapely

from autowaze.cloud.admission import CarefulAdmission
from autowaze.cloud.fleet import Fleet
from autowaze.cloud.methods import METHODS
from autowaze.cloud.service import CloudService
from autowaze.world.feature_map import MapFeatures
from autowaze.world.features import DESCRIPTOR_BYTES
from autowaze.world.georeference import Georeference
from autowaze.world.ground import GroundCells
from autowaze.world.identity import feature_ids, instance_keys
from autowaze.world.labels import ClassLabel
from autowaze.world.map_diff import InstanceSummaries, SemanticMapDiff, Trajectory
from autowaze.world.parking import ParkingMap, ParkingSpot
from autowaze.world.wire import decode_diff, encode_diff

_GEOREFERENCE = Georeference(0.0, 0.0)
_SPOTS = ParkingMap(
    tuple(ParkingSpot(str(row), shapely.box(2.0, 6.0 * row, 4.2, 6.0 * row + 6.0)) for row in range(2)), _GEOREFERENCE
)
_CARS, _POINTS, _POLES = 2, 12, 4
_START, _WINDOW_S = 1e9, 5.0


@cache
def rehearse() -> None:
    """Take three passes of a made-up street into a service of each method that is kept nowhere; once per process."""
    fleet = Fleet(None)
    for method in METHODS:
        service, admission = CloudService(_SPOTS, method), CarefulAdmission()
        for session in (1, 2, 3):  # the second finds all of the first gone, the third what the second found
            gone = feature_ids(1, 0, _CARS * _POINTS + _POLES) if session == 2 else np.zeros(0, np.uint64)
            payload = encode_diff(_pass(session, gone))
            diff = decode_diff(payload)
            admission.admit(diff, None, service)
            service.receive(payload)
            admission.note(diff, diff.end)
            fleet.note(diff)


def _pass(session: int, removed: np.ndarray) -> SemanticMapDiff:
    """A car drives north past two parked cars and some poles."""
    start = _START + session * 600.0
    rng = np.random.default_rng(session)
    owner = np.repeat(np.arange(_CARS + 1), [_POLES, *[_POINTS] * _CARS])  # 0 is nobody's
    count = len(owner)
    middle = np.array([[-4.0, 5.0, 2.0], [3.1, 3.0, 0.7], [3.1, 7.9, 0.7]])  # the second leans over the line
    position = middle[owner] + rng.uniform(-0.8, 0.8, (count, 3))
    descriptor = np.zeros((count, DESCRIPTOR_BYTES), np.uint8)
    descriptor[:_POLES] = rng.integers(1, 256, (_POLES, DESCRIPTOR_BYTES))
    new = MapFeatures(
        id=feature_ids(session, 0, count),
        position=position,
        descriptor=descriptor,
        normal=np.tile(np.array([-1.0, 0.0, 0.0], np.float32), (count, 1)),
        min_distance=np.full(count, 1.0, np.float32),
        max_distance=np.full(count, 30.0, np.float32),
        label=np.where(owner > 0, ClassLabel.CAR, ClassLabel.BACKGROUND).astype(np.uint8),
        instance_key=instance_keys(session, owner),
        first_seen=np.full(count, start),
        last_seen=np.full(count, start + _WINDOW_S),
        observations=np.full(count, 5, np.uint16),
    )
    cars = np.arange(1, _CARS + 1)
    iy, ix = (axis.ravel() for axis in np.mgrid[0:48, 0:20])
    stands = (ix > 8) & (iy > 20)
    votes = (~stands).astype(np.uint16), stands.astype(np.uint16)
    along = np.arange(0.0, _WINDOW_S + 1.0)
    path = np.column_stack([np.zeros(len(along)), 2.0 * along, np.ones(len(along))])
    return SemanticMapDiff(
        session=session,
        sequence=0,
        start=start,
        end=start + _WINDOW_S,
        georeference=_GEOREFERENCE,
        frames=50,
        localized_frames=50,
        position_sigma_m=0.1,
        new=new,
        removed=removed,
        instances=InstanceSummaries(
            cars.astype(np.int32),
            np.full(_CARS, ClassLabel.CAR, np.uint8),
            np.full(_CARS, 0.8, np.float32),
            np.tile(np.array([1.0, 0.0], np.float32), (_CARS, 1)),
            np.full(_CARS, 20, np.uint16),
        ),
        ground=GroundCells(ix.astype(np.int32), iy.astype(np.int32), *votes),
        trajectory=Trajectory(start + along, path, np.zeros(len(along), np.float32)),
    )
