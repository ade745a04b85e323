"""What the thesis printed (chapter 4), to stand beside what is measured here."""

from __future__ import annotations

METHODS: dict[str, dict[str, tuple[float, float, float]]] = {
    "town": {
        "orb-slam2": (0.67, 0.98, 0.76),
        "carmap": (0.77, 0.88, 0.82),
        "thesis": (0.87, 0.91, 0.89),
    },
    "real-world-like": {"orb-slam2": (0.78, 0.87, 0.75), "thesis": (0.93, 0.82, 0.84)},
}
"""Precision, recall and accuracy by experiment and method: tables 4.1 and 4.2."""

LATENCY_MS = {"tracking": 41.0, "diff": 9.0, "cloud": 47.0, "end to end": 100.0}
"""Section 4.3; a GPU for segmentation."""

DIFF_BYTES = (1_000, 60_000)
"""Smallest and largest of a window of 5 s (section 4.5)."""
