"""Recordings as other people publish them: cut into pieces that begin in motion, each with its pose set to 0, 0, 0."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Signal

SIGNALS = ("commands", "wheels", "gyro", "poses")


def in_pieces(
    recording: Recording, seconds: float, *, every: float = 0.0, pause: float = 5.0, first: float = 2.0
) -> Recording:
    """Return the recording cut into pieces of so many seconds, one begun `every` so many, with pauses between them.

    The first begins `first` [s] after the recording. By default each begins where the one before ends.
    """
    parts = list(_parts(recording, seconds, every or seconds, pause, first))
    signals: dict[str, Any] = {}
    for name in SIGNALS:
        own = [part[name] for part in parts]
        fields = {field: np.concatenate([signal[field] for signal in own]) for field in own[0].fields}
        signals[name] = Signal(np.concatenate([signal.utime for signal in own]), fields)
    return replace(recording, **signals)


def _parts(
    recording: Recording, seconds: float, every: float, pause: float, first: float
) -> Iterator[dict[str, Signal]]:
    start, end = recording.poses.utime[0], recording.poses.utime[-1]
    number = 0
    while (begin := start + (first + number * every) / SECONDS) + seconds / SECONDS <= end:
        shift = round((number * (seconds + pause) - (begin - start) * SECONDS) / SECONDS)
        part = {}
        for name in SIGNALS:
            signal = getattr(recording, name).between(int(begin), int(begin + seconds / SECONDS))
            fields = _from_origin(signal) if name == "poses" else signal.fields
            part[name] = Signal(signal.utime + shift, dict(fields))
        yield part
        number += 1


def _from_origin(poses: Signal) -> dict[str, Floats]:
    """Return poses seen from the first of them."""
    x, y = poses["x"] - poses["x"][0], poses["y"] - poses["y"][0]
    cosine, sine = np.cos(poses["theta"][0]), np.sin(poses["theta"][0])
    return {"x": cosine * x + sine * y, "y": cosine * y - sine * x, "theta": poses["theta"] - poses["theta"][0]}
