"""What can be set about the semantic map diff."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class DiffSettings(BaseModel):
    """Thresholds of persistent, new and removed.

    Attributes:
        window_s: length of a time window (thesis, sec. 4.5: five seconds).
        session_s: how long a session goes on at most before the car draws a new number (docs/security.md).
        min_visible_frames: a stored feature counts as looked for when that many frames predict it visible.
        max_position_sigma_m: frames whose pose is less certain say nothing about what is gone.
        min_localized_fraction: a window with fewer localized frames sends no removals.
        min_match_ratio: share of the features predicted visible that must match for a miss to mean anything; below
            it the light or the pose is to blame.
        gone_match_ratio: a feature, or a neighbourhood of features, that matches in at most this share of the frames
            is not there. Chance gives less than 0.05, a standing car 0.3 or more.
        min_group: features of a neighbourhood that must be looked for before its absence counts; a vehicle or bicycle
            that has fewer is not told of.
        neighbourhood_m: edge of the cells that features are grouped by.
        min_found_static, min_found_vehicle: frames that must have matched a new feature. Cars are passed in 6 to 12
            frames, so theirs are few.
        max_depth_sigma_m: a new feature must have been seen near enough for its depth to be this certain; of one that
            stands, the place, by all views together.
        max_offset_px: or else it must be so certain, if it stands, that a car in the next lane will see it so nearly
            where it is foretold.
        max_new_static: described features per window; the best-seen ones, spread in space.
        max_per_instance: features per instance.
        spread_on_vehicle_m: they are spread over cells of this edge, so that what is seen of a vehicle the next time
            lies near a stored one.
        max_diff_bytes: room for the whole diff; static features take what vehicles and ground leave (thesis, sec. 4.5:
            at most 60 KB).
        known_radius_m: where a vehicle feature lies this near to a stored one, something still stands there.
        same_radius_m: a vehicle most of whose features lie so near to stored ones, their own errors apart, is the one
            that the map holds.
        spread_m: static features are spread over cells of this edge before the best-seen are kept; one this near to a
            stored one is no news.
        enough_stored: a frame that finds so many standing features of the map needs no more of them there: what only
            such frames saw is no news. Twice what a pose needs to be sure of itself; a map that shows a car 100 is
            found by it wherever it is switched on, one that shows 60 to 90 is not (docs/evaluation.md, size of a map).
        trajectory_interval_s: time between points of the trajectory, at the least.
        trajectory_tolerance_m: points that even motion between others foretells so well are left out.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    window_s: float = Field(default=5.0, gt=0, le=3600)
    session_s: float = Field(default=86_400.0, gt=0)
    min_visible_frames: int = Field(default=3, ge=1)
    max_position_sigma_m: float = Field(default=0.15, gt=0)
    min_localized_fraction: float = Field(default=0.5, ge=0, le=1)
    min_match_ratio: float = Field(default=0.25, ge=0, le=1)
    gone_match_ratio: float = Field(default=0.15, ge=0, le=1)
    min_group: int = Field(default=4, ge=1)
    neighbourhood_m: float = Field(default=1.0, gt=0)
    min_found_static: int = Field(default=3, ge=1)
    min_found_vehicle: int = Field(default=2, ge=1)
    max_depth_sigma_m: float = Field(default=0.35, gt=0)
    max_offset_px: float = Field(default=2.0, ge=0)
    max_new_static: int = Field(default=1000, ge=0)
    max_per_instance: int = Field(default=100, ge=1)
    spread_on_vehicle_m: float = Field(default=0.25, gt=0)
    max_diff_bytes: int = Field(default=55_000, ge=2000)
    known_radius_m: float = Field(default=0.35, gt=0)
    same_radius_m: float = Field(default=0.1, gt=0)
    spread_m: float = Field(default=0.5, gt=0)
    enough_stored: int = Field(default=100, ge=0)
    trajectory_interval_s: float = Field(default=1.0, gt=0)
    trajectory_tolerance_m: float = Field(default=0.25, ge=0)
