"""How long each stage takes (thesis, sec. 4.3, Fig. 4.3)."""

from __future__ import annotations

import numpy as np

from autowaze.cloud.service import CloudService
from autowaze.evaluation.drive import DriveRecord
from autowaze.vehicle.node import VehicleNode
from autowaze.world.stage_times import StageTimes

_TRACKING = ("features", "slam")
"""What the thesis counts as tracking: features with depth, matching, pose."""


def latency_metrics(record: DriveRecord, node: VehicleNode, cloud: CloudService | None = None) -> dict[str, float]:
    """Medians and 95th percentiles in milliseconds, by stage; with the cloud in the same process its stages too.

    End to end is from a window's last frame to the update that it led to.
    """
    out: dict[str, float] = {}
    tracking = np.sum([node.times.milliseconds[stage] for stage in _TRACKING], axis=0)
    out["track_ms_median"] = float(np.median(tracking))
    out["track_ms_p95"] = float(np.percentile(tracking, 95))
    out.update(_by_stage(node.times))
    if cloud is None:
        return out
    out.update({f"cloud_{name}": value for name, value in _by_stage(cloud.times).items()})
    if record.end_to_end_ms:
        out["end_to_end_ms_median"] = float(np.median(record.end_to_end_ms))
    return out


def _by_stage(times: StageTimes) -> dict[str, float]:
    medians, p95s = times.median_ms(), times.p95_ms()
    names = {stage: stage.replace(" ", "_") for stage in medians}
    return {
        key: value
        for stage, name in names.items()
        for key, value in ((f"{name}_ms_median", medians[stage]), (f"{name}_ms_p95", p95s[stage]))
    }
