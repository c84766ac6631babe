"""Recordings of emulated drives, and faults to put into them."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from cmr.recordings import Recorder, Recording
from cmr.recordings.findings import Findings
from cmr.recordings.signal import Floats, Mask, Signal
from tests.support.emulated_drive import figure_eight, messages

Duties = Callable[[float], tuple[float, float]]


def lively(share: float) -> tuple[float, float]:
    """Fast turns both ways, reversals and abrupt starts."""
    time = 30.0 * share
    return 0.5 * math.sin(1.3 * time) + 0.3 * math.sin(5.0 * time), 0.5 * math.sin(1.1 * time + 1.0)


def circle(_share: float) -> tuple[float, float]:
    return 0.2, 0.5


def at_rest(_share: float) -> tuple[float, float]:
    return 0.0, 0.0


@cache
def recording(duties: Duties = figure_eight, seed: int = 0) -> Recording:
    recorder = Recorder(0)
    for channel, message in messages(duties=duties, seed=seed):
        recorder.handle(message.utime, channel, message)
    return recorder.recording()


def without(whole: Recording, *names: str) -> Recording:
    return whole.where({name: np.zeros(len(whole.signals[name]), np.bool_) for name in names})


def placed(whole: Recording, x: Floats, y: Floats, theta: Floats) -> Recording:
    fields = {"x": x, "y": y, "theta": np.remainder(theta + np.pi, 2.0 * np.pi) - np.pi}
    return replace(whole, poses=replace(whole.poses, fields=fields))


def moved(whole: Recording, at: Mask | slice, shift: complex, turn: float = 0.0) -> Recording:
    """Return the recording with the poses `at` turned about the origin and shifted."""
    poses = whole.poses
    place, theta = poses["x"] + 1j * poses["y"], poses["theta"].copy()
    place[at] = place[at] * np.exp(1j * turn) + shift
    theta[at] += turn
    return placed(whole, place.real, place.imag, theta)


def by_lidar(whole: Recording, seed: int, noise: float = 0.03, every: int = 10) -> Recording:
    """Return the recording with fewer and noisier poses."""
    rng = np.random.default_rng(seed)
    whole = whole.where({"poses": np.arange(len(whole.poses)) % every == 0})
    poses, count = whole.poses, len(whole.poses)
    x, y = (poses[name] + rng.normal(0.0, noise, count) for name in ("x", "y"))
    return placed(whole, x, y, poses["theta"] + rng.normal(0.0, 0.02, count))


def later(whole: Recording, name: str, seconds: float) -> Recording:
    signal = whole.signals[name]
    delayed: dict[str, Signal] = {name: replace(signal, utime=signal.utime + round(seconds * 1e6))}
    return replace(whole, **delayed)  # type: ignore[arg-type]


def scattered(whole: Recording, seed: int, least: float, share: float = 0.02, burst: int = 1) -> tuple[Recording, Mask]:
    """Return the recording with outliers of `least` to twice that many metres, and where they are."""
    rng = np.random.default_rng(seed)
    count = len(whole.poses)
    wrong = np.zeros(count, np.bool_)
    while np.count_nonzero(wrong) < share * count:
        first = rng.integers(1, count - burst)
        if burst == 1 or not wrong[max(first - 12, 0) : first + burst + 12].any():
            wrong[first : first + burst] = True
    off = least * rng.uniform(1.0, 2.0, count) * np.exp(2j * np.pi * rng.uniform(size=count))
    return moved(whole, wrong, off[wrong]), wrong


def set_aside(findings: Findings, check_name: str, signal: str) -> Mask:
    return findings[check_name].set_aside[signal]
