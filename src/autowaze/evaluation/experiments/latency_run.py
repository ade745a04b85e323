"""Times of car and service on a machine that does nothing else (thesis, sec. 4.3)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from autowaze.cloud.methods import FUSED
from autowaze.cloud.service import CloudService
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.drive import Progress, run_drive
from autowaze.traces import Trace
from autowaze.vehicle.node import VehicleNode
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.feature_map import FeatureMap
from autowaze.world.parking import ParkingMap

END_TO_END = "end to end"
_CLOUD = "cloud: "
_WARM_UP_FRAMES = 12
_SESSION = 1 << 21


@dataclass
class StageTable:
    """Milliseconds by stage, of every frame or diff.

    Attributes:
        others_busy: processes that wanted a core when it began, on average over the minute before; times of a machine
            that does other things too are longer.
    """

    milliseconds: dict[str, list[float]] = field(default_factory=dict)
    others_busy: float = 0.0

    def add(self, prefix: str, stages: dict[str, list[float]]) -> None:
        """Take in more of some stages."""
        for name, values in stages.items():
            self.milliseconds.setdefault(prefix + name, []).extend(values)

    def summary(self) -> dict[str, tuple[float, float]]:
        """Median and 95th percentile of each, in the order in which they came."""
        return {
            name: (float(np.median(values)), float(np.percentile(values, 95)))
            for name, values in self.milliseconds.items()
            if values
        }

    def metrics(self) -> dict[str, float]:
        """Flat names for reports."""
        out: dict[str, float] = {"load_average": self.others_busy}
        for name, (median, p95) in self.summary().items():
            key = name.replace(_CLOUD, "cloud_").replace(",", "").replace(" ", "_")
            out |= {f"{key}_ms_median": median, f"{key}_ms_p95": p95}
        return out


def measure_latency(
    traces: Sequence[Trace], spots: ParkingMap, base_map: FeatureMap, segmenter: Segmenter, progress: Progress
) -> StageTable:
    """Drive traces of one street with a service in the same process; some frames before the clock counts."""
    table = StageTable(others_busy=os.getloadavg()[0])
    for number, trace in enumerate(traces):
        start = starting_point(trace, spots, Start.GNSS)
        if number == 0:
            _warm_up(trace, spots, base_map, segmenter)
        cloud = CloudService(spots, FUSED, base_map)
        node = VehicleNode(
            trace.camera, segmenter, stored_map=base_map, start=start, session=_SESSION + number, spots=spots
        )
        record = run_drive(trace, node, cloud.receive, progress)
        stages = {name: list(values) for name, values in node.times.milliseconds.items()}
        table.add("", stages)
        table.add(_CLOUD, {name: list(values) for name, values in cloud.times.milliseconds.items()})
        table.add("", {END_TO_END: record.end_to_end_ms})
    return table


def _warm_up(trace: Trace, spots: ParkingMap, base_map: FeatureMap, segmenter: Segmenter) -> None:
    """Compilers and caches."""
    start = starting_point(trace, spots, Start.GNSS)
    node = VehicleNode(trace.camera, segmenter, stored_map=base_map, start=start, session=_SESSION - 1, spots=spots)
    cloud = CloudService(spots, FUSED, base_map)
    for index in range(min(_WARM_UP_FRAMES, len(trace))):
        node.process(trace[index])
    diff = node.finish()
    if diff is not None:
        cloud.integrate(diff)
