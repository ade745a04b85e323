"""What a drive costs on the network (thesis, sec. 4.5)."""

from __future__ import annotations

import numpy as np

from autowaze.evaluation.drive import DriveRecord


def network_metrics(record: DriveRecord) -> dict[str, float]:
    """Bytes per diff and per kilometre, and what the diffs held."""
    sizes = [len(message) for message in record.messages]
    if not sizes:
        return {"diffs": 0.0}
    return {
        "diffs": float(len(sizes)),
        "diff_bytes_median": float(np.median(sizes)),
        "diff_bytes_p95": float(np.percentile(sizes, 95)),
        "diff_bytes_max": float(max(sizes)),
        "bytes_per_km": 1000 * sum(sizes) / max(record.distance_m, 1.0),
        "new_features": float(sum(len(diff.new) for diff in record.diffs)),
        "removed_features": float(sum(len(diff.removed) for diff in record.diffs)),
    }
