"""Recordings that somebody cut into short pieces are calibrated from all of them."""

from pathlib import Path

import numpy as np
import pytest

from cmr.calibration.calibrator import Calibrator
from cmr.recordings.recording import Recording, read_messages
from cmr.recordings.signal import Signal
from tests.hidden_effects import hidden_recording
from tests.hidden_effects.cases import EIGHT
from tests.hidden_effects.logs import write_log
from tests.hidden_effects.pieces import SIGNALS, in_pieces

pytestmark = pytest.mark.slow


def twice(recording: Recording) -> Recording:
    """Return the recording and, 5 s after its end, the same again."""
    ago = int(recording.pieces.last[-1]) - int(recording.pieces.first[0]) + 5_000_000
    signals = {}
    for name in SIGNALS:
        once = getattr(recording, name)
        fields = {field: np.tile(values, 2) for field, values in once.fields.items()}
        signals[name] = Signal(np.concatenate([once.utime, once.utime + ago]), fields)
    return recording.with_signals(signals)


def used_of(recording: Recording, folder: Path) -> tuple[int, float]:
    """Return the time [us] of the last pose of a log that a calibration uses, and how many seconds it leaves out."""
    calibrator = Calibrator.of(read_messages(write_log(folder / "log.lcm", recording)))
    return int(calibrator.recording().poses.utime[-1]), calibrator.left_out


def test_of_a_recording_in_short_pieces_all_are_used(tmp_path: Path) -> None:
    whole = hidden_recording(manoeuvre=EIGHT, seed=4).recording
    pieces = twice(in_pieces(whole, 4.0, first=0.0))  # each time the first piece begins at rest
    assert used_of(pieces, tmp_path) == (int(pieces.poses.utime[-1]), 0.0)
