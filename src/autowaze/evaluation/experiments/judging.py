"""What each variant says after every drive of a series, spot by spot, beside what is true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.cloud.service import CloudService
from autowaze.evaluation.base_map import integrated
from autowaze.evaluation.experiments.passage import Passage
from autowaze.evaluation.experiments.truth import DriveTruth
from autowaze.evaluation.experiments.variants import Memory, Variant
from autowaze.world.feature_map import FeatureMap
from autowaze.world.labels import is_vehicle
from autowaze.world.parking import Occupancy, ParkingMap
from autowaze.world.vehicles import VehicleBoxes

OWN_CAR_IOU = 0.3
"""A box is of the car on a spot when they overlap by so much (intersection over union)."""
_NEAR_IOU = 0.1


@dataclass(frozen=True)
class Verdict:
    """What was said of one spot after one drive.

    Attributes:
        drive: name.
        counts: whether the drive could see the spot well enough to be asked.
        seen_before: whether any drive of the series so far had any of it in view.
        said, probability_vacant: the answer.
        evidence: what the service gives as reason.
        own_car: an occupied spot whose own car has a box that belongs to the spot.
        centre_error_m, heading_error_rad: of the box nearest to its own car; NaN without one.
    """

    drive: str
    spot_id: str
    occupied: bool
    counts: bool
    seen_before: bool
    said: Occupancy
    probability_vacant: float
    evidence: str
    own_car: bool
    centre_error_m: float
    heading_error_rad: float

    @property
    def is_right(self) -> bool:
        """Whether the answer is the true one."""
        return self.said is (Occupancy.OCCUPIED if self.occupied else Occupancy.VACANT)


@dataclass(frozen=True)
class JudgedSeries:
    """Everything that one variant said of one series.

    Attributes:
        verdicts: of all judged drives, all spots.
    """

    street: str
    variant: str
    verdicts: tuple[Verdict, ...]


@dataclass(frozen=True)
class DrivenSeries:
    """A series as it was driven: what the cars sent and what was true, drive by drive.

    The survey is apart, and so is the drive during which nothing had changed.
    """

    street: str
    spots: ParkingMap
    survey: Passage | None
    names: tuple[str, ...]
    passages: tuple[Passage, ...]
    truths: tuple[DriveTruth, ...]
    unchanged: Passage | None = None

    @property
    def base_map(self) -> FeatureMap | None:
        """What the survey found."""
        return integrated(self.survey.messages, self.spots.georeference) if self.survey else None


def judge(series: DrivenSeries, variant: Variant) -> JudgedSeries:
    """Let a service take the diffs of all drives, and hear what it says after each."""
    base_map = series.base_map
    cloud = _service(series.spots, variant, base_map)
    verdicts: list[Verdict] = []
    seen: set[str] = set()
    for number, (name, passage, truth) in enumerate(zip(series.names, series.passages, series.truths, strict=True)):
        if variant.memory is not Memory.CARRIED:
            cloud = _service(series.spots, variant, base_map)
        for message in variant.messages(passage, series.spots, number):
            cloud.receive(message)
        seen |= {spot.spot_id for spot in truth.spots if spot.glimpsed}
        verdicts += _verdicts(name, cloud, truth, seen)
    return JudgedSeries(series.street, variant.name, tuple(verdicts))


def service_after(series: DrivenSeries, variant: Variant, drive: str) -> CloudService:
    """The service as it is after a drive, for pictures."""
    base_map = series.base_map
    cloud = _service(series.spots, variant, base_map)
    for number, (name, passage) in enumerate(zip(series.names, series.passages, strict=True)):
        if variant.memory is not Memory.CARRIED:
            cloud = _service(series.spots, variant, base_map)
        for message in variant.messages(passage, series.spots, number):
            cloud.receive(message)
        if name == drive:
            break
    return cloud


def overlaps(corners: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Intersection over union (N, M) of outlines (N, 4, 2) and (M, 4, 2)."""
    if len(corners) == 0 or len(others) == 0:
        return np.zeros((len(corners), len(others)))
    one = np.asarray(shapely.polygons(corners), dtype=np.object_)[:, None]
    two = np.asarray(shapely.polygons(others), dtype=np.object_)[None, :]
    common = shapely.area(shapely.intersection(one, two))
    return np.asarray(common / (shapely.area(one) + shapely.area(two) - common))


def _service(spots: ParkingMap, variant: Variant, base_map: FeatureMap | None) -> CloudService:
    if base_map is None or variant.memory is Memory.NONE:
        return CloudService(spots, variant.method)
    if variant.memory is Memory.STANDING:
        standing = base_map.features[~is_vehicle(base_map.features.label)]
        base_map = FeatureMap(standing, base_map.georeference, base_map.version)
    return CloudService(spots, variant.method, base_map)


def _verdicts(name: str, cloud: CloudService, truth: DriveTruth, seen: set[str]) -> list[Verdict]:
    boxes, states = cloud.vehicle_boxes, {state.spot_id: state for state in cloud.states}
    iou = overlaps(truth.corners, boxes.corners)
    home = _homes(boxes, cloud)
    row_of = {spot_id: row for row, spot_id in enumerate(cloud.spots.ids)}
    found = []
    for spot in truth.spots:
        state = states[spot.spot_id]
        own, centre_error, heading_error = False, np.nan, np.nan
        if spot.vehicle >= 0 and len(boxes):
            of_it = iou[spot.vehicle]
            own = bool(((of_it >= OWN_CAR_IOU) & (home == row_of[spot.spot_id])).any())
            best = int(of_it.argmax())
            if of_it[best] >= _NEAR_IOU:
                centre_error = float(np.linalg.norm(boxes.centre[best] - truth.centre[spot.vehicle]))
                turn = (boxes.heading[best] - truth.heading[spot.vehicle] + np.pi / 2) % np.pi - np.pi / 2
                heading_error = abs(float(turn))
        found.append(
            Verdict(
                drive=name,
                spot_id=spot.spot_id,
                occupied=spot.occupied,
                counts=spot.counts,
                seen_before=spot.spot_id in seen,
                said=state.occupancy,
                probability_vacant=state.probability_vacant,
                evidence=state.evidence,
                own_car=own and state.occupancy is Occupancy.OCCUPIED,
                centre_error_m=centre_error,
                heading_error_rad=heading_error,
            )
        )
    return found


def _homes(boxes: VehicleBoxes, cloud: CloudService) -> NDArray[np.int64]:
    """Row (B,) of the spot that each box overlaps most; -1 for none."""
    home = np.full(len(boxes), -1, np.int64)
    most = np.zeros(len(boxes))
    outlines = boxes.polygons
    for box, spot in zip(*cloud.spots.overlapping(outlines), strict=True):
        area = shapely.area(shapely.intersection(outlines[box], cloud.spots.polygons[spot]))
        if area > most[box]:
            home[box], most[box] = spot, area
    return home


def confusion_counts(verdicts: Sequence[Verdict]) -> NDArray[np.int64]:
    """True vacant, false vacant, vacant missed, true occupied, occupied without an answer: (5,) over counted spots."""
    counted = [v for v in verdicts if v.counts]
    return np.array(
        [
            sum(not v.occupied and v.is_right for v in counted),
            sum(v.occupied and v.said is Occupancy.VACANT for v in counted),
            sum(not v.occupied and not v.is_right for v in counted),
            sum(v.occupied and v.is_right for v in counted),
            sum(v.occupied and v.said is Occupancy.UNKNOWN for v in counted),
        ],
        dtype=np.int64,
    )
