"""What operators measure: counts, sizes, delays, stage times, in Prometheus's text format."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from autowaze.cloud.service import CloudService
from autowaze.world.parking import Occupancy

DELAY_BOUNDS_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)
RECENT_S = 60.0
MOST_RECENT = 1 << 15
"""Diffs of the last minute that are remembered one by one."""


@dataclass(frozen=True)
class RecentDiffs:
    """The diffs of the last minute."""

    per_second: float
    delays_ms: list[float]


@dataclass
class Meters:
    """Counts of the running process.

    Attributes:
        accepted, repeated: diffs by what became of them.
        refusals: diffs that were refused, by reason.
        received_bytes: of those that were taken in, repeated ones included.
        delays: diffs by the first bound that their delay, from arrival to durable and broadcast, did not pass.
        clock: monotonic seconds.
    """

    accepted: int = 0
    repeated: int = 0
    refusals: Counter[str] = field(default_factory=Counter)
    received_bytes: int = 0
    delay_sum_s: float = 0.0
    delays: list[int] = field(default_factory=lambda: [0] * (len(DELAY_BOUNDS_S) + 1))
    clock: Callable[[], float] = time.monotonic
    _newest: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=MOST_RECENT))

    def __post_init__(self) -> None:
        self._started = self.clock()

    @property
    def refused(self) -> int:
        """Diffs that were refused, whatever the reason."""
        return self.refusals.total()

    def refuse(self, reason: str) -> None:
        """Count a diff that was refused."""
        self.refusals[reason] += 1

    def taken_in(self, accepted: bool, size: int, delay_s: float) -> None:
        """Count a diff that was taken in, or had been before."""
        self.accepted += accepted
        self.repeated += not accepted
        self.received_bytes += size
        self.delay_sum_s += delay_s
        self.delays[bisect_left(DELAY_BOUNDS_S, delay_s)] += 1
        self._newest.append((self.clock(), 1000 * delay_s))

    def recent(self, now: float) -> RecentDiffs:
        """What was taken in during the last minute before now, or since the start if that is less long ago."""
        newest = [(at, delay_ms) for at, delay_ms in self._newest if at > now - RECENT_S]
        since = max(now - RECENT_S, self._started, newest[0][0] if len(newest) == MOST_RECENT else self._started)
        return RecentDiffs(len(newest) / max(now - since, 1.0), [delay_ms for _, delay_ms in newest])


@dataclass(frozen=True)
class ServiceFigures:
    """What the service says of itself at one moment."""

    map_version: int
    spots: dict[Occupancy, int]
    stages_s: dict[tuple[str, str], float]

    @classmethod
    def of(cls, service: CloudService) -> ServiceFigures:
        """The figures now; stage times by stage and quantile."""
        medians, p95s = service.times.median_ms(), service.times.p95_ms()
        stages = {(stage, "0.5"): ms / 1000 for stage, ms in medians.items()}
        stages |= {(stage, "0.95"): ms / 1000 for stage, ms in p95s.items()}
        counts = Counter(state.occupancy for state in service.states)
        return cls(service.map.version, {state: counts[state] for state in Occupancy}, stages)


def exposition(meters: Meters, figures: ServiceFigures, waiting: int, listeners: int) -> str:
    """All of it, https://prometheus.io/docs/instrumenting/exposition_formats/."""
    results = {"accepted": meters.accepted, "repeated": meters.repeated, "refused": meters.refused}
    lines = [
        *_metric("diffs_total", "counter", "Diffs by result.", ((f'{{result="{k}"}}', v) for k, v in results.items())),
        *_metric(
            "diffs_refused_total",
            "counter",
            "Refused diffs by reason.",
            ((f'{{reason="{reason}"}}', n) for reason, n in sorted(meters.refusals.items())),
        ),
        *_metric("diff_bytes_total", "counter", "Bytes of diffs taken in.", [("", meters.received_bytes)]),
        *_metric("diff_delay_seconds", "histogram", "From arrival to durable and broadcast.", _histogram(meters)),
        *_metric(
            "stage_seconds",
            "gauge",
            "Time per stage over the newest diffs.",
            ((f'{{stage="{stage}",quantile="{q}"}}', v) for (stage, q), v in figures.stages_s.items()),
        ),
        *_metric(
            "spots",
            "gauge",
            "Spots by state when last observed.",
            ((f'{{state="{state}"}}', n) for state, n in figures.spots.items()),
        ),
        *_metric("map_version", "gauge", "Version of the map.", [("", figures.map_version)]),
        *_metric("diffs_waiting", "gauge", "Diffs that wait to be taken in.", [("", waiting)]),
        *_metric("change_listeners", "gauge", "Clients that follow changes.", [("", listeners)]),
    ]
    return "\n".join(lines) + "\n"


def _histogram(meters: Meters) -> Iterable[tuple[str, float]]:
    total = 0
    for bound, count in zip((*DELAY_BOUNDS_S, "+Inf"), meters.delays, strict=True):
        total += count
        yield f'_bucket{{le="{bound}"}}', total
    yield "_sum", meters.delay_sum_s
    yield "_count", total


def _metric(name: str, kind: str, meaning: str, values: Iterable[tuple[str, float]]) -> list[str]:
    name = f"autowaze_{name}"
    return [f"# HELP {name} {meaning}", f"# TYPE {name} {kind}", *(f"{name}{suffix} {v!r}" for suffix, v in values)]
