"""What can be set about SLAM."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SlamSettings:
    """Tracking and mapping; the defaults follow ORB-SLAM2 (Mur-Artal & Tardos 2017) where it names a number."""

    n_levels: int = 8
    scale_factor: float = 1.2
