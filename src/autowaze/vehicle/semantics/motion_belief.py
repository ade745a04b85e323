"""What is believed of an instance's motion: log-odds of moving, its velocity, and the way that it has come of late."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.displacement import ACCELERATION, Place, Velocity, log_normal, velocity_over
from autowaze.vehicle.semantics.looming import SizeSight, Stature
from autowaze.world.labels import ClassLabel

# Before any evidence: vehicles mostly stand at the kerb, people mostly walk.
_PRIOR_LOG_ODDS = {ClassLabel.PERSON: 1.0, ClassLabel.ANIMAL: 1.0, ClassLabel.TWO_WHEELER: 0.0}
_PRIOR_LOG_ODDS_OTHERS = -1.0
_MAX_LOG_ODDS, _MAX_STEP = 6.0, 3.0
_Seen = TypeVar("_Seen", Place, SizeSight)

_GOES_ON = 0.5  # share of what moves that goes on as before; of the rest half goes anywhere, half along the street
_CRAWL_MPS = 0.5


@dataclass(frozen=True, slots=True)
class MotionSettings:
    """What can be set about telling moving from parked.

    Attributes:
        spans_s: how long ago the frames were that features are compared with, the longest first.
        min_matches: features that must be found again.
        pixel_sigma, disparity_sigma: errors of a feature in pixels at octave 0.
        common_disparity_sigma: error in pixels that all features of an instance share.
        pose_sigma_m, pose_sigma_rad: error of the motion between two frames.
        still_mps, moving_mps: standard deviation of the speed of what stands and of what moves anywhere.
        along_mps, across_mps: of what keeps to the street, and goes ahead of the car or comes towards it.
        place_span_s: least and greatest time over which places tell a velocity.
        place_interval_s: least time between two of them.
        well_known_mps: standard deviation of a velocity by features up to which places have nothing to add.
        forget_s: an instance not seen for so long is forgotten.
    """

    spans_s: tuple[float, ...] = (0.5, 0.3, 0.1)
    min_matches: int = 3
    pixel_sigma: float = 0.7
    disparity_sigma: float = 0.5
    common_disparity_sigma: float = 0.15
    pose_sigma_m: float = 0.03
    pose_sigma_rad: float = 0.001
    still_mps: float = 0.15
    moving_mps: float = 5.0
    along_mps: float = 8.0
    across_mps: float = 0.7
    place_span_s: tuple[float, float] = (1.0, 3.0)
    place_interval_s: float = 0.09
    well_known_mps: float = 1.0
    forget_s: float = 10.0


class MotionBelief:
    """Of one instance.

    Attributes:
        velocity: (2,) m/s, if it moves.
        last_seen: seconds.
        stature: how high it is.
    """

    def __init__(self, settings: MotionSettings, label: ClassLabel) -> None:
        self.settings = settings
        self.velocity = np.zeros(2)
        self.last_seen = -np.inf
        self.stature = Stature(label)
        self._covariance = np.eye(2) * settings.moving_mps**2
        self._log_odds = _PRIOR_LOG_ODDS.get(label, _PRIOR_LOG_ODDS_OTHERS)
        self._way_tells = 0.0
        self._places: deque[Place] = deque()
        self._sights: deque[SizeSight] = deque()

    @property
    def moving(self) -> bool:
        """Whether it rather moves, by all looks, and by the way of late, which every frame tells again, once."""
        return self._log_odds + self._way_tells > 0

    def take_place(
        self,
        place: Place,
        sight: SizeSight | None,
        ahead: NDArray[np.float64],
        elapsed: float,
        found: Velocity | None,
    ) -> None:
        """Take in where it is, after the velocity that its features told in this frame, if they did.

        Where they told it well, or better than the way of late does, nothing is added: that is of the seconds
        before, and a track may have come from another vehicle.

        Args:
            place: by its features.
            sight: where it is seen whole and as large as stereo says.
            ahead: (2,) unit vector, the way that the car looks over ground.
            elapsed: seconds since the frame before.
            found: the velocity.
        """
        is_known = found is not None and _spread(found) < self.settings.well_known_mps
        self._way_tells = 0.0 if is_known else self._way_tells
        if sight is not None:
            self._keeps(self._sights, sight)
        if not self._keeps(self._places, place):
            return
        self._way_tells = 0.0
        way = None if is_known else self._way(sight)
        if way is not None and (found is None or _spread(found) >= _spread(way)):
            self._way_tells = max(self.log_factor(way, ahead), 0.0)
            self.weigh(way, ahead, elapsed, is_news=found is None)

    def _keeps(self, some: deque[_Seen], one: _Seen) -> bool:
        """Forget the old ones, and keep this one if it is not too soon after the last."""
        while some and one.timestamp - some[0].timestamp > self.settings.place_span_s[1]:
            some.popleft()
        is_soon = bool(some) and one.timestamp - some[-1].timestamp < self.settings.place_interval_s
        if not is_soon:
            some.append(one)
        return not is_soon

    def _way(self, now: SizeSight | None) -> Velocity | None:
        """The velocity by size, or else by where its features are, over a second at least."""
        least = self.settings.place_span_s[0]
        way = self.stature.way(self._sights, now, least) if now is not None else None
        if way is None and self._places[-1].timestamp - self._places[0].timestamp >= least:
            way = velocity_over(self._places)
        return way

    def weigh(self, found: Velocity, ahead: NDArray[np.float64], elapsed: float, is_news: bool = True) -> None:
        """Take in a measured velocity.

        Args:
            found: the velocity.
            ahead: (2,) unit vector, the way that the car looks over ground.
            elapsed: seconds since the frame before.
            is_news: whether no better one of this frame was taken in.
        """
        # Spans of successive frames overlap: each brings only its own share of news.
        step = np.clip(self.log_factor(found, ahead) * min(elapsed / found.span, 1.0), -_MAX_STEP, _MAX_STEP)
        self._log_odds = float(np.clip(self._log_odds + step, -_MAX_LOG_ODDS, _MAX_LOG_ODDS))
        if not is_news:
            return
        drifted = self._covariance + np.eye(2) * (ACCELERATION * elapsed) ** 2
        gain = drifted @ np.linalg.inv(drifted + found.covariance)
        self.velocity = self.velocity + gain @ (found.mean - self.velocity)
        self._covariance = drifted - gain @ drifted

    def log_factor(self, found: Velocity, ahead: NDArray[np.float64]) -> float:
        """Log of the Bayes factor of moving over standing.

        What moves goes anywhere, or keeps to the street, or goes on as before, which is as likely as both. If all went
        anywhere, that a car ahead does not move sideways, which is seen well, would outweigh that it drives on, which
        at 20 m is seen badly; and one look alone tells less than ten that say the same.
        """
        s, (x, y) = self.settings, ahead
        axes = np.array([[x, -y], [y, x]])
        traffic = axes * [s.along_mps**2, s.across_mps**2] @ axes.T
        before = self._covariance + np.eye(2) * (ACCELERATION * found.span) ** 2
        moving = (
            log_normal(found.mean, found.covariance + np.eye(2) * s.moving_mps**2),
            log_normal(found.mean, found.covariance + traffic),
            log_normal(found.mean - self.velocity, found.covariance + before),
        )
        still = log_normal(found.mean, found.covariance + np.eye(2) * s.still_mps**2)
        # What has come to rest does not go on as before.
        goes_on = _GOES_ON * (1.0 - math.exp(-float(self.velocity @ self.velocity) / (2.0 * _CRAWL_MPS**2)))
        shares, most = ((1.0 - goes_on) / 2, (1.0 - goes_on) / 2, goes_on), max(moving)
        return most + math.log(sum(w * math.exp(m - most) for w, m in zip(shares, moving, strict=True))) - still


def _spread(velocity: Velocity) -> float:
    """Standard deviation in m/s."""
    return math.sqrt(float(np.trace(velocity.covariance)))
