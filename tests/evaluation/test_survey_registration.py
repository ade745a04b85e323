"""A survey whose odometry was wrong by a hundredth, laid onto the parking map by the cars that stood there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from street import SPEED_MPS, Street

from autowaze.evaluation.drive import DriveRecord
from autowaze.evaluation.survey_registration import register_survey
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.displacement import displaced
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import ParkingMap
from autowaze.world.pose import make_pose
from autowaze.world.wire import decode_diff, encode_diff

TOO_LONG = 1.012
TAKEN = [0, 1, 3, 4, 5, 7, 8, 10, 11, 12, 14]


def _stretched(street: Street) -> tuple[DriveRecord, list[SemanticMapDiff]]:
    """What such a survey has recorded, and its diffs as they should be."""
    true = street.drive(street.park([spot for spot in TAKEN if spot < street.count]))
    record, start = DriveRecord(), true[0].start
    for diff in true:
        path = diff.trajectory.position[:, :2]
        wrong = displaced(diff, path, (TOO_LONG - 1.0) * path)
        record.diffs.append(decode_diff(encode_diff(wrong)))
        record.messages.append(encode_diff(wrong))
    for number, time in enumerate(np.arange(start, true[-1].end, 0.5)):
        place = np.append(street.along * SPEED_MPS * (time - start) * TOO_LONG, 1.6)
        nothing = np.zeros(0, np.int64)
        record.tracked.append(
            TrackedFrame(
                number,
                time,
                TrackingState.ODOMETRY,
                "",
                make_pose(np.eye(3), place),
                np.eye(6),
                99,
                0,
                nothing,
                nothing,
            )
        )
    return record, true


def _off(diffs: list[SemanticMapDiff], true: list[SemanticMapDiff]) -> NDArray[np.float64]:
    return np.concatenate([a.new.position[:, :2] - b.new.position[:, :2] for a, b in zip(diffs, true, strict=True)])


@pytest.mark.parametrize("bays", [True, False])
def test_a_stretched_survey_is_laid_onto_the_parking_map(bays: bool) -> None:
    street = Street(bays=bays)
    record, true = _stretched(street)
    before = np.linalg.norm(_off(record.diffs, true), axis=1)
    register_survey(record, street.parking_map)
    after = np.linalg.norm(_off(record.diffs, true), axis=1)
    assert np.percentile(after, 95) < 0.5 * np.percentile(before, 95)
    assert np.percentile(after, 95) < (0.25 if bays else 0.5)


def test_messages_say_what_the_diffs_do() -> None:
    street = Street(bays=True)
    record, _ = _stretched(street)
    register_survey(record, street.parking_map)
    for diff, message in zip(record.diffs, record.messages, strict=True):
        sent = decode_diff(message)
        assert sent.new.position == pytest.approx(diff.new.position, abs=0.02)
        assert sent.trajectory.position == pytest.approx(diff.trajectory.position, abs=0.02)


def test_without_spots_a_survey_stays_as_it_is() -> None:
    street = Street(count=4)
    record, _ = _stretched(street)
    before = list(record.messages)
    register_survey(record, ParkingMap((), street.parking_map.georeference))
    assert record.messages == before


def test_no_two_cells_of_the_ground_meet() -> None:
    street = Street(count=4)
    diff = street.drive(street.park([0, 1, 3]))[0]
    path = diff.trajectory.position[:, :2]
    squeezed = displaced(diff, path, -0.05 * path).ground
    cells = np.stack([squeezed.ix, squeezed.iy], axis=1)
    assert len(np.unique(cells, axis=0)) == len(cells)
    assert len(cells) < len(diff.ground)
    assert replace(diff, ground=squeezed).ground.free.max() == diff.ground.free.max()
