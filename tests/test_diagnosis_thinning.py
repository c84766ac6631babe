"""Long drives are thinned evenly, and where the path begins anew it still does."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.diagnosis import thinning
from cmr.diagnosis.experiment import Piece, pieces_of
from cmr.diagnosis.thinning import share_used, thinned
from cmr.model.observer import RESTART
from tests.hidden_effects import hidden_recording

EVERY = 4


@pytest.fixture(scope="module")
def piece() -> Piece:
    """Return a drive whose path begins anew once, at a pose that thinning leaves out."""
    (whole,) = pieces_of(hidden_recording(manoeuvre="figure_eight", seed=0).recording, [], 0)
    pose_use = whole.heard.pose_use.copy()
    pose_use[EVERY * 100 + 1] = RESTART
    return replace(whole, heard=replace(whole.heard, pose_use=pose_use))


def test_every_sensor_keeps_its_share_of_readings_at_their_times(piece: Piece) -> None:
    heard, fewer = piece.heard, thinned(piece, EVERY).heard
    for name in ("wheel_time", "wheel", "gyro_time", "gyro", "pose_time", "pose"):
        np.testing.assert_array_equal(getattr(fewer, name), getattr(heard, name)[::EVERY])
    np.testing.assert_array_equal(fewer.left, heard.left)


def test_a_new_beginning_is_kept_at_the_next_pose_used(piece: Piece) -> None:
    begins = np.flatnonzero(thinned(piece, EVERY).heard.pose_use == RESTART)
    assert list(begins) == [0, 101]


def test_readings_are_left_out_only_when_there_are_more_than_memory_is_for(
    piece: Piece, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = piece.heard
    readings = 2 * len(heard.wheel_time) + len(heard.gyro_time) + 3 * len(heard.pose_time)
    assert share_used([piece]) == 1
    assert thinned(piece, 1) is piece
    monkeypatch.setattr(thinning, "MOST_READINGS", readings // 3)
    assert share_used([piece]) == (4 if readings % 3 else 3)
