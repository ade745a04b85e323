"""The ways from what cars sent to what is believed of spots: methods, baselines, ablations, maps that are off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import shapely

from autowaze.cloud.methods import CARMAP, FUSED, ORB_SLAM2, THESIS, Method
from autowaze.evaluation.experiments.passage import Passage
from autowaze.vehicle.ground_grid import ground_that_matters
from autowaze.world.feature_map import MapFeatures
from autowaze.world.ground import CELL_M, GroundCells
from autowaze.world.identity import feature_ids
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import ParkingMap
from autowaze.world.wire import decode_diff, encode_diff

OFFSETS_M = (0.3, 0.6, 1.0, 1.5)
_ROAD_BELOW_CAMERA_M = 1.65
"""All rigs of the experiments, and KITTI's, are mounted so high."""
_VEHICLE_HEIGHTS_M = (0.3, 2.0)


class Memory(Enum):
    """What a drive finds at the service."""

    CARRIED = "carried"
    """What all drives before have left, as a service that goes on has it."""
    STANDING = "standing"
    """The survey's standing features, no vehicles: each drive judged by itself."""
    NONE = "none"


@dataclass(frozen=True)
class Variant:
    """One way.

    Attributes:
        name: as in tables.
        method: how the service decides.
        memory: what each drive finds.
        whole_map: the car sends its whole map instead of diffs.
        above_road: of that map only what stands above the road, so that asphalt makes no clusters.
        offset_m: how far each drive's position is off, in a direction of its own.
    """

    name: str
    method: Method
    memory: Memory = Memory.CARRIED
    whole_map: bool = False
    above_road: bool = False
    offset_m: float = 0.0

    def messages(self, passage: Passage, spots: ParkingMap, number: int) -> list[bytes]:
        """What the car sends in this variant of a drive."""
        if self.whole_map:
            return _above_road(passage) if self.above_road else passage.full_map
        if not self.offset_m:
            return passage.messages
        angle = np.random.default_rng([number, 31]).uniform(0.0, 2.0 * np.pi)
        shift = self.offset_m * np.array([np.cos(angle), np.sin(angle)])
        area = ground_that_matters(spots)
        pairs = zip(passage.diffs, passage.wide_ground, strict=True)
        return [encode_diff(_displaced(diff, ground, shift, area)) for diff, ground in pairs]


METHODS = (
    Variant("orb-slam2", ORB_SLAM2, Memory.NONE, whole_map=True),
    Variant("orb-slam2, points above the road", ORB_SLAM2, Memory.NONE, whole_map=True, above_road=True),
    Variant("carmap", CARMAP),
    Variant("carmap, each drive alone", CARMAP, Memory.STANDING),
    Variant("thesis", THESIS),
    Variant("fused", FUSED),
)

ABLATIONS = (
    Variant("thesis", THESIS),
    Variant("thesis, DBSCAN for instance ids", replace(THESIS, instance_ids=False)),
    Variant("thesis, no second pass", replace(THESIS, second_pass=False)),
    Variant("thesis, no outlier removal", replace(THESIS, outlier_removal=False)),
    Variant("thesis, nothing removed", replace(THESIS, removals=False)),
    Variant("fused", FUSED),
    Variant("fused, DBSCAN for instance ids", replace(FUSED, instance_ids=False)),
    Variant("fused, no outlier removal", replace(FUSED, outlier_removal=False)),
    Variant("fused, boxes around the centroid", replace(FUSED, visible_side=False)),
    Variant("fused, no ground", replace(FUSED, ground=False)),
    Variant("fused, newest pass alone", replace(FUSED, memory=False)),
    Variant("fused, no corroboration", replace(FUSED, corroboration=False)),
)

OFFSETS = tuple(
    Variant(f"{method.name}, {offset_m:g} m off", method, offset_m=offset_m)
    for method in (THESIS, FUSED)
    for offset_m in OFFSETS_M
)


def _displaced(
    diff: SemanticMapDiff,
    ground: GroundCells,
    shift: np.ndarray[tuple[int], np.dtype[np.float64]],
    area: shapely.Geometry,
) -> SemanticMapDiff:
    """What a car would send that is off by a shift (2,) and does not know it."""
    new = (
        replace(diff.new, position=diff.new.position + np.append(shift, 0.0)) if len(diff.new) else MapFeatures.empty()
    )
    cells = np.rint(shift / CELL_M).astype(np.int32)
    moved = GroundCells(ground.ix + cells[0], ground.iy + cells[1], ground.free, ground.obstacle)
    moved = moved[np.asarray(shapely.contains_xy(area, *moved.centre.T), dtype=np.bool_)]
    position = diff.trajectory.position + np.append(shift, 0.0)
    return replace(diff, new=new, ground=moved, trajectory=replace(diff.trajectory, position=position))


def _above_road(passage: Passage) -> list[bytes]:
    """The whole map without the road and without what hangs above cars."""
    road = float(np.median([z for _, _, z in passage.path])) - _ROAD_BELOW_CAMERA_M
    low, high = (road + height for height in _VEHICLE_HEIGHTS_M)
    messages = []
    for diff in map(decode_diff, passage.full_map):
        height = diff.new.position[:, 2]
        kept = diff.new[(height > low) & (height < high)]
        kept = replace(kept, id=feature_ids(diff.session, diff.sequence, len(kept)))
        messages.append(encode_diff(replace(diff, new=kept)))
    return messages
