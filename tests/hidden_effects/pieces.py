"""Recordings as other people publish them: cut into pieces that begin in motion, each with its pose set to 0, 0, 0."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Signal

SIGNALS = ("commands", "velocity_commands", "wheels", "gyro", "poses")
JUMPS = (0.2, 1.0)  # m, of a lidar that finds itself elsewhere; it turns by as many rad as half of that


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


def with_jumps(recording: Recording, share: float, random: np.random.Generator) -> Recording:
    """Return the recording with a jump in this share of its pieces: from there on its poses are of another frame."""
    poses = recording.poses
    first = recording.pieces.first
    number = np.searchsorted(first, poses.utime, side="right") - 1
    place, theta = poses["x"] + 1j * poses["y"], poses["theta"].copy()
    for piece in np.flatnonzero(random.random(len(first)) < share):
        own = np.flatnonzero(number == piece)
        after = own[int(len(own) * random.uniform(0.2, 0.8)) :]
        size, along, way = random.uniform(*JUMPS), random.uniform(-np.pi, np.pi), random.choice((-0.5, 0.5))
        turn = size * way
        # It turns about the place of the jump.
        place[after] = (
            place[after[0]] + (place[after] - place[after[0]]) * np.exp(1j * turn) + size * np.exp(1j * along)
        )
        theta[after] += turn
    return replace(recording, poses=Signal(poses.utime, {"x": place.real, "y": place.imag, "theta": theta}))
