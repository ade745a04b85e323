"""What a diff costs the cloud: on one street, among 100 and 100,000 spots, and with ten million features besides.

python -m benchmarks cloud

Ten million features take 1.1 GB, and as much again while the city's map is put together.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from shapely.affinity import translate

from autowaze.cloud.service import CloudService
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.identity import MAX_FEATURES_PER_DIFF, feature_ids
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import ParkingMap
from autowaze.world.stage_times import StageTimes
from autowaze.world.wire import encode_diff

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "cloud"))
from street import GEOREFERENCE, Street

STREET = Street()
PASSES = 40
TOWN_SPOTS, CITY_SPOTS, CITY_FEATURES = 100, 100_000, 10_000_000
BLOCK_M = 130.0
BASE_SESSION = 999
TURNS = 3
TOTAL = "integrate_and_occupancy_ms_median"


def city_spots(count: int) -> ParkingMap:
    """The street at the origin and copies of it around, so many spots in all."""
    own = STREET.parking_map.spots
    blocks = -(-count // len(own))
    side = int(np.ceil(np.sqrt(blocks)))
    spots = []
    for block in sorted(range(blocks), key=lambda b: b != side // 2 * side + side // 2):  # the origin's own first
        column, row = block % side - side // 2, block // side - side // 2
        for spot in own:
            moved = translate(spot.polygon, column * BLOCK_M, row * BLOCK_M)
            spots.append(replace(spot, id=f"{column}/{row}/{spot.id}", polygon=moved))
    return ParkingMap(tuple(spots[:count]), GEOREFERENCE)


def city_map(count: int) -> FeatureMap:
    """Static features all over the city, one block per earlier diff."""
    rng = np.random.default_rng(0)
    blocks = -(-count // MAX_FEATURES_PER_DIFF)
    per_block = [min(MAX_FEATURES_PER_DIFF, count - b * MAX_FEATURES_PER_DIFF) for b in range(blocks)]
    sessions = [BASE_SESSION + b // 4096 for b in range(blocks)]
    ids = [feature_ids(s, b % 4096, n) for b, (s, n) in enumerate(zip(sessions, per_block, strict=True))]
    ones, zeros = np.ones(count, np.float32), np.zeros(count)
    features = MapFeatures(
        id=np.concatenate(ids),
        position=rng.uniform(-5000.0, 5000.0, (count, 3)),
        descriptor=np.zeros((count, 32), np.uint8),
        normal=np.zeros((count, 3), np.float32),
        min_distance=ones,
        max_distance=ones,
        label=np.zeros(count, np.uint8),
        instance_key=np.zeros(count, np.uint64),
        first_seen=zeros,
        last_seen=zeros,
        observations=np.ones(count, np.uint16),
    )
    return FeatureMap(features, GEOREFERENCE)


def passes(count: int) -> list[SemanticMapDiff]:
    """Cars that drive the street one after the other, each removing what the one before it added."""
    drives: list[list[SemanticMapDiff]] = []
    for number in range(count):
        parked = np.random.default_rng(number).choice(STREET.count, 10, replace=False).tolist()
        drives.append(STREET.drive(STREET.park(parked, number), session=number + 1, start=1000.0 + 600.0 * number))
        if number:
            gone = [diff.new.id for diff in drives[-2]]
            drives[-1] = [replace(diff, removed=ids) for diff, ids in zip(drives[-1], gone, strict=False)]
    return [diff for drive in drives for diff in drive]


def measure(service: CloudService, payloads: list[bytes], clock: Callable[[], float]) -> dict[str, float]:
    """Milliseconds per stage, median, after a first pass that compiles and builds rasters."""
    service.times = StageTimes(clock)
    for payload in payloads:
        service.receive(payload)
    times = {stage: list(values)[6:] for stage, values in service.times.milliseconds.items()}
    total = np.sum([values for stage, values in times.items() if stage != "decode"], axis=0)
    medians = {f"{stage}_ms_median": round(float(np.median(values)), 3) for stage, values in times.items()}
    return medians | {
        TOTAL: round(float(np.median(total)), 3),
        "integrate_and_occupancy_ms_p95": round(float(np.percentile(total, 95)), 3),
    }


def run() -> None:
    """Print one JSON object per case, in milliseconds of wall time and of this thread's CPU time.

    The cost of a diff among 100,000 spots over that of 100 is `city_over_town`: both are measured in turns, for a
    machine is never equally fast for long.
    """
    diffs = passes(PASSES)
    payloads = [encode_diff(diff) for diff in diffs]
    town, city = city_spots(TOWN_SPOTS), city_spots(CITY_SPOTS)
    for clock in (time.perf_counter, time.thread_time):
        of_town, of_city = (
            np.mean([measured[TOTAL] for measured in turns], axis=0)
            for turns in zip(
                *((measure(CloudService(s), payloads, clock) for s in (town, city)) for _ in range(TURNS)), strict=True
            )
        )
        found = {"100_spots_ms": round(float(of_town), 3), "100000_spots_ms": round(float(of_city), 3)}
        ratio = round(float(of_city / of_town), 3)
        print(json.dumps({"case": "town and city", "clock": clock.__name__} | found | {"city_over_town": ratio}))
    base = city_map(CITY_FEATURES)
    for clock in (time.perf_counter, time.thread_time):
        for method in ("thesis", "fused"):
            street, whole = CloudService(STREET.parking_map, method), CloudService(city, method, base)
            for case, service in (("15 spots", street), (f"{len(city)} spots, {len(base)} features", whole)):
                named = {"case": f"{case}, {method}", "clock": clock.__name__}
                print(json.dumps(named | measure(service, payloads, clock)))
