"""Recordings with longer rests: what stands on the floor goes on to be recorded."""

from collections.abc import Mapping

import numpy as np

from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Signal, Times

# Standard deviations of readings of a robot that rests, by field: rad/s, m, rad.
NOISE: Mapping[str, float] = {"yaw_rate": 0.003, "x": 0.002, "y": 0.002, "theta": 0.003}
COUNTED = ("ticks_left", "ticks_right")  # what is 0 of a robot that rests is all else of its wheels and commands
SIGNALS = ("commands", "wheels", "gyro", "poses")


def with_rests(recording: Recording, before: float, after: float, seed: int = 0) -> Recording:
    """Return the recording of a robot that begins and ends at rest, with `before` and `after` [s] more of its rest."""
    random = np.random.default_rng(seed)
    return recording.with_signals(
        {name: _longer(getattr(recording, name), before, after, random) for name in SIGNALS if getattr(recording, name)}
    )


def _longer(signal: Signal, before: float, after: float, random: np.random.Generator) -> Signal:
    step = int(np.median(np.diff(signal.utime)))
    early, late = (np.arange(1, int(seconds / SECONDS) // step, dtype=np.int64) * step for seconds in (before, after))
    utime = np.concatenate([signal.utime[0] - early[::-1], signal.utime, signal.utime[-1] + late])

    def at_rest(name: str, place: int, count: Times) -> Floats:
        values = signal[name]
        if name in COUNTED:
            return np.full(len(count), values[place])
        if name not in NOISE:
            return np.where(np.isfinite(values[place]), 0.0, np.nan) * np.ones(len(count))
        stays = np.median(values[:20] if place == 0 else values[-10:])
        return np.asarray(stays + NOISE[name] * random.standard_normal(len(count)), np.float64)

    fields = {
        name: np.concatenate([at_rest(name, 0, early), signal[name], at_rest(name, -1, late)]) for name in signal.fields
    }
    return Signal(utime, fields)


def one_after_another(recordings: list[Recording], pause: float) -> Recording:
    """Return recordings that begin and end at rest as one, `pause` [s] apart; the robot is carried in between."""
    first, *others = recordings
    signals = {name: [getattr(first, name)] for name in SIGNALS}
    end = max(int(parts[0].utime[-1]) for parts in signals.values() if len(parts[0]))
    for other in others:
        begin = min(int(getattr(other, name).utime[0]) for name in SIGNALS if len(getattr(other, name)))
        moved = round(pause / SECONDS) + end - begin
        for name, parts in signals.items():
            signal = getattr(other, name)
            parts.append(Signal(signal.utime + moved, signal.fields))
        end = max(int(parts[-1].utime[-1]) for parts in signals.values() if len(parts[-1]))
    return first.with_signals(
        {
            name: Signal(
                np.concatenate([one.utime for one in parts]),
                {field: np.concatenate([one[field] for one in parts]) for field in parts[0].fields},
            )
            for name, parts in signals.items()
        }
    )
