"""A drive goes on under new session numbers, and keeps its ends to itself."""

from dataclasses import replace

import numpy as np
import pytest

from autowaze.vehicle.diffing import DiffSettings, DiffWindow, FrameObservation
from autowaze.vehicle.private_ends import PrivateEnds
from autowaze.vehicle.semantics.motion import Motions
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.identity import MAX_SEQUENCE
from autowaze.world.instances import Tracks
from autowaze.world.map_diff import SemanticMapDiff, Trajectory
from autowaze.world.wire import decode_diff, encode_diff

CAMERA = StereoCamera(fx=700.0, fy=700.0, cx=320.0, cy=120.0, baseline_m=0.5, width=640, height=240)


def lost(timestamp):
    none = np.zeros(0, np.int64)
    tracked = TrackedFrame(0, timestamp, TrackingState.LOST, "dark", np.eye(4), np.eye(6), 0, 0, none, none)
    return FrameObservation(tracked, CameraFeatures.empty(), Tracks.empty(4, 4), Motions.empty(), None)


def windows(window, count, start=0.0):
    diffs = []
    for number in range(count):
        for frame in range(2):
            window.add(lost(start + 5.0 * number + 2.5 * frame), Landmarks())
        diffs.append(window.close(Landmarks()))
    return diffs


def test_a_session_ends_when_its_time_is_up():
    window = DiffWindow(CAMERA, 1, DiffSettings(session_s=20.0))
    over = []
    for number in range(4):
        windows(window, 1, start=5.0 * number)
        over.append(window.is_session_over)
    assert over == [False, False, False, True]
    window.begin_session(2)
    diff = windows(window, 1, start=20.0)[0]
    assert (diff.session, diff.sequence) == (2, 0)
    assert not window.is_session_over


def test_a_session_ends_when_its_numbers_run_out():
    window = DiffWindow(CAMERA, 1, DiffSettings(session_s=1e9))
    diffs = windows(window, MAX_SEQUENCE)
    assert decode_diff(encode_diff(diffs[-1])).sequence == MAX_SEQUENCE - 1
    assert window.is_session_over


def drive(count, step_m=50.0):
    """Diffs of 50 m each, along a line."""
    for number in range(count):
        position = np.array([[step_m * number, 0.0, 0.0], [step_m * (number + 1), 0.0, 0.0]])
        path = Trajectory(np.array([5.0 * number, 5.0 * number + 5.0]), position, np.zeros(2, np.float32))
        yield encode_diff(replace(SemanticMapDiff(1, number, 5.0 * number, 5.0 * number + 5.0), trajectory=path))


@pytest.mark.parametrize(("ends_m", "first", "last"), [(0.0, 0, 19), (100.0, 2, 17), (120.0, 3, 16), (600.0, 0, -1)])
def test_what_lies_near_the_ends_is_never_sent(ends_m, first, last):
    sent = []
    private = PrivateEnds(ends_m, sent.append)
    for message in drive(20):
        private.send(message)
    assert [decode_diff(message).sequence for message in sent] == list(range(first, last + 1))
