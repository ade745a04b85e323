"""What it costs to find the nearest free spots in a city of 100,000 spots."""

from __future__ import annotations

import time

import numpy as np
from shapely import LineString

from autowaze.cloud.api.spot_book import FadingStates
from autowaze.cloud.nearest import SpotFinder
from autowaze.cloud.routing import TravelMode
from autowaze.world.georeference import Georeference
from autowaze.world.parking import Occupancy, SpotState
from autowaze.world.streets import StreetNetwork, streets

BLOCKS, BLOCK_M = 200, 60.0
"""12 km across: 80,000 streets, each a block long."""
SPOTS = 100_000
NOW = 1_000_000.0
ASKED = 200


def city(rng: np.random.Generator) -> tuple[StreetNetwork, np.ndarray]:
    """A grid of crooked streets, a third of them one-way, and spots beside them."""
    corner = np.stack(np.meshgrid(np.arange(BLOCKS + 1), np.arange(BLOCKS + 1), indexing="ij"), axis=-1) * BLOCK_M
    corner = corner + rng.normal(0, 6, corner.shape)
    ends = np.concatenate(
        [
            np.stack([corner[:-1], corner[1:]], axis=2).reshape(-1, 2, 2),
            np.stack([corner[:, :-1], corner[:, 1:]], axis=2).reshape(-1, 2, 2),
        ]
    )
    bend = ends.mean(axis=1) + rng.normal(0, 4, (len(ends), 2))
    lines = [LineString([a, b, c]) for (a, c), b in zip(ends, bend, strict=True)]
    oneway, speed = rng.random(len(lines)) < 0.33, rng.choice([30.0, 50.0], len(lines))
    street, share = rng.integers(0, len(lines), SPOTS), rng.random((SPOTS, 1))
    beside = ends[street, 0] + share * (ends[street, 1] - ends[street, 0]) + rng.normal(0, 4, (SPOTS, 2))
    return StreetNetwork(Georeference(40.0, -73.0), streets(lines, oneway=oneway, speed_kmh=speed)), beside


def run() -> None:
    """Print CPU milliseconds per question."""
    rng = np.random.default_rng(0)
    network, centre = city(rng)
    started = time.process_time()
    finder = SpotFinder(network)
    spots = finder.place(centre)
    print(f"{len(network)} streets and {SPOTS} spots taken in: {time.process_time() - started:.1f} s of CPU")
    for share in (0.2, 0.02):
        vacant = rng.random(SPOTS) < share
        probability = np.where(vacant, 0.97, 0.03)
        seen = NOW - rng.uniform(0, 3600, SPOTS)
        columns = zip(vacant.tolist(), probability.tolist(), seen.tolist(), strict=True)
        states = [
            SpotState(str(row), Occupancy.VACANT if free else Occupancy.OCCUPIED, p, at)
            for row, (free, p, at) in enumerate(columns)
        ]
        fading = FadingStates(states, NOW, fades=True)
        for mode in TravelMode:
            cost_ms, wall_ms, routed = [], [], 0
            for _ in range(ASKED):
                point = rng.uniform(0.1, 0.9, 2) * BLOCKS * BLOCK_M
                wall, cpu = time.perf_counter(), time.thread_time()
                along_streets, found = finder.nearest(point, mode, 5, spots, fading.probabilities)
                cost_ms.append(1000 * (time.thread_time() - cpu))
                wall_ms.append(1000 * (time.perf_counter() - wall))
                routed += along_streets and len(found) == 5
            print(
                f"{mode}, {share:.0%} vacant: CPU median {np.median(cost_ms):.1f} ms, p95 "
                f"{np.percentile(cost_ms, 95):.1f} ms; wall median {np.median(wall_ms):.1f} ms; "
                f"5 routed spots in {routed} of {ASKED} answers"
            )
