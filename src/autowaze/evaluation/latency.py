"""How long each stage takes (thesis, sec. 4.3, Fig. 4.3)."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from autowaze.cloud.service import CloudService
from autowaze.evaluation.drive import DriveRecord
from autowaze.evaluation.published import PublishedDrive
from autowaze.vehicle.node import VehicleNode
from autowaze.world.stage_times import StageTimes

_TRACKING = ("features", "slam")
"""What the thesis counts as tracking: features with depth, matching, pose."""
_AMORTISED = {"diff": ("diff", "closing"), "ground": ("dense stereo", "ground")}
"""What is not done in every frame, and its work in those that do it, as a share of every frame."""


def latency_metrics(record: DriveRecord, node: VehicleNode, cloud: CloudService | None = None) -> dict[str, float]:
    """Medians and 95th percentiles in milliseconds, by stage; with the cloud in the same process its stages too.

    End to end is from a window's last frame to the update that it led to.
    """
    out = _of_the_car(node.times)
    if cloud is None:
        return out
    out.update({f"cloud_{name}": value for name, value in _by_stage(cloud.times).items()})
    if record.end_to_end_ms:
        out["end_to_end_ms_median"] = float(np.median(record.end_to_end_ms))
    return out


def published_metrics(passes: Sequence[PublishedDrive], service_ms: dict[str, float]) -> dict[str, float]:
    """Milliseconds by stage over all passes; end to end for the first one, whose map is empty, and the others apart."""
    times = StageTimes()
    for one in passes:
        for stage, values in one.times.milliseconds.items():
            times.milliseconds.setdefault(stage, deque()).extend(values)
    out = _of_the_car(times)
    out |= {f"cloud_{stage.replace(' ', '_')}_ms_median": ms for stage, ms in service_ms.items()}
    for prefix, some in (("empty_map_", passes[:1]), ("known_map_", passes[1:]), ("", passes)):
        published = [ms for one in some for ms in one.published_ms]
        if not published:
            continue
        closed = [ms for one in some for ms in one.closing_ms]
        handed_in = np.array(published) - closed
        sizes = [len(message) for one in some for message in one.record.messages[: len(one.published_ms)]]
        out |= {
            f"{prefix}windows": float(len(published)),
            f"{prefix}diff_bytes_median": float(np.median(sizes)),
            f"{prefix}last_frame_to_diff_ms_median": float(np.median(closed)),
            f"{prefix}diff_to_listener_ms_median": float(np.median(handed_in)),
            f"{prefix}end_to_end_ms_median": float(np.median(published)),
            f"{prefix}end_to_end_ms_max": float(np.max(published)),
        }
    return out


def _of_the_car(times: StageTimes) -> dict[str, float]:
    tracking = np.sum([times.milliseconds[stage] for stage in _TRACKING], axis=0)
    out = {
        "track_ms_median": float(np.median(tracking)),
        "track_ms_p95": float(np.percentile(tracking, 95)),
    } | _by_stage(times)
    per_frame = {
        name: sum(sum(times.milliseconds.get(stage, ())) for stage in stages) / len(tracking)
        for name, stages in _AMORTISED.items()
    }
    return out | {f"{name}_ms_per_frame": mean for name, mean in per_frame.items()}


def _by_stage(times: StageTimes) -> dict[str, float]:
    medians, p95s = times.median_ms(), times.p95_ms()
    names = {stage: stage.replace(" ", "_") for stage in medians}
    return {
        key: value
        for stage, name in names.items()
        for key, value in ((f"{name}_ms_median", medians[stage]), (f"{name}_ms_p95", p95s[stage]))
    }
