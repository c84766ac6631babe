"""Drives of the reference plant in which something changes, as messages; and what a watcher says to them."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PARAMETERS, POSE, Stream
from cmr.diagnosis.live import Watcher
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal
from tests.reference_plant import NEUTRAL, REALISTIC, Drive, drive, packets
from tests.reference_plant.drives import START_UTIME
from tests.reference_plant.manoeuvres import Manoeuvre, constant, figure_eight, in_turn, multisine

TRUE = ParameterFile(
    0,
    {
        "wheel_radius": Value(NEUTRAL.wheel_radius),
        "k2_over_k3": Value(NEUTRAL.k2_over_k3),
        "k1": Value(NEUTRAL.k1),
        "base_width": Value(NEUTRAL.base_width),
    },
)
CHANGE = 45.0  # s after the start, when something changes
END = 65.0  # s
LAP = 25.0  # s of a figure-eight

Message = tuple[int, str, Any]
Said = list[tuple[float, str]]  # s since the start, sentence


def messages(
    recording: Recording, robot_id: int = 0, voltage: Callable[[float], float] = lambda _time: math.nan, status: int = 0
) -> list[Message]:
    """The messages of a recording in the order of their stamps; `voltage` [V] by time [s], `status` once it changes."""
    rolled = _of(MOTOR_FEEDBACK, recording.wheels, robot_id)
    for utime, _, message in rolled:
        message.battery_voltage = voltage(_seconds(utime))
        message.status = status if _seconds(utime) > CHANGE else 0
    # Every second reading of the gyro is enough, and saves the tests a quarter of their time.
    turned = _of(GYRO, recording.gyro.where(np.arange(len(recording.gyro)) % 2 == 0), robot_id)
    for _, _, message in turned:
        message.valid = 1
    others = _of(MOTOR_COMMAND, recording.commands, robot_id) + _of(POSE, recording.poses, robot_id)
    return sorted(rolled + turned + others, key=lambda message: message[0])


def _of(stream: Stream[Any], signal: Signal, robot_id: int) -> list[Message]:
    columns = {name: values.tolist() for name, values in signal.fields.items() if not name.startswith("ticks")}
    result: list[Message] = []
    for utime, *values in zip(signal.utime.tolist(), *columns.values(), strict=True):
        message = stream.message_type()
        message.utime, message.robot_id = utime, robot_id
        for name, value in zip(columns, values, strict=True):
            setattr(message, name, value)
        result.append((utime, stream.channel(robot_id), message))
    return result


def _seconds(utime: int) -> float:
    return (utime - START_UTIME) * 1e-6


def follow(file: ParameterFile | None = TRUE) -> Callable[[int], ParameterFollower]:
    """What makes followers that know a file from the start."""

    def follower(robot_id: int) -> ParameterFollower:
        result = ParameterFollower(robot_id)
        if file is not None:
            announced = replace(file, robot_id=robot_id).announcement(1)
            result.handle(announced.utime, PARAMETERS.channel(robot_id), announced)
        return result

    return follower


def watch(heard: Iterable[Message], watcher: Watcher | None = None, every: int = 500_000) -> Said:
    """What a watcher says when it is asked every so many microseconds."""
    watcher = watcher or Watcher(follow())
    said: Said = []
    due = 0
    for utime, channel, message in heard:
        watcher.handle(utime, channel, message)
        if utime >= due:
            due = utime + every
            said += [(_seconds(utime), sentence) for sentence in watcher.advance(utime)]
    return said + [(math.inf, sentence) for sentence in watcher.advance(due)]


def eight(seconds: float) -> Manoeuvre:
    return figure_eight(seconds, round(seconds / LAP))


def errands(seconds: float, seed: int) -> Manoeuvre:
    """Straights, spins, circles, rests and shaking, at random."""
    random = np.random.default_rng(seed)
    parts: list[tuple[float, Manoeuvre]] = []
    while sum(duration for duration, _ in parts) < seconds:
        duty, sign = float(random.uniform(0.15, 0.8)), float(random.choice([-1.0, 1.0]))
        kinds = [
            constant(duty, duty),
            constant(-0.4 * duty * sign, 0.4 * duty * sign),
            constant(duty, duty * float(random.uniform(0.4, 1.0))),
            constant(0.0, 0.0),
            multisine(1.0, sign, 0.5),
        ]
        parts.append((float(random.uniform(1.0, 6.0)), kinds[random.integers(len(kinds))]))
    return in_turn(parts)


def driven(manoeuvre: Manoeuvre, parameters: Mapping[str, float], seconds: float = END, seed: int = 1) -> Drive:
    return drive(packets(manoeuvre, seconds), parameters, seconds, REALISTIC, seed)


@cache
def undisturbed(seed: int) -> Drive:
    return driven(eight(END), {}, seed=seed)


def edited(recording: Recording, signal: str, **edits: Callable[[Floats, Floats], Floats]) -> Recording:
    """The recording with fields of a signal replaced; each edit gets times since the change [s] and values."""
    old = recording.signals[signal]
    since: Floats = np.asarray((old.utime - START_UTIME) * 1e-6 - CHANGE, np.float64)
    fields = {name: edits[name](since, values) if name in edits else values for name, values in old.fields.items()}
    return with_signal(recording, signal, Signal(old.utime, fields))


def without(recording: Recording, signal: str, since: float = 0.0) -> Recording:
    """The recording in which a signal ends at `since` [s]."""
    old = recording.signals[signal]
    return with_signal(recording, signal, old.where((old.utime - START_UTIME) * 1e-6 < since))


def with_signal(recording: Recording, name: str, signal: Signal) -> Recording:
    parts: dict[str, Any] = {name: signal}
    return replace(recording, **parts)


def slipping(ride: Drive, left: float, right: float, seconds: float = math.inf, period: float = math.inf) -> Recording:
    """The recording of a drive whose sides go by these shares less far than the wheels turn, from CHANGE on.

    For `seconds`, and again after every `period` [s].
    """
    truth, recording = ride.truth, ride.recording
    time: Floats = np.asarray((truth.utime - START_UTIME) * 1e-6, np.float64)
    slips = (time >= CHANGE) & (np.mod(time - CHANGE, period) < seconds)
    ground = {
        side: NEUTRAL.wheel_radius * truth[f"psi_{side}"] * np.where(slips, 1.0 - share, 1.0)
        for side, share in (("left", left), ("right", right))
    }
    rate = (ground["right"] - ground["left"]) / NEUTRAL.base_width
    theta = _integral(rate, time)
    speed = (ground["left"] + ground["right"]) / 2.0
    moved = {
        "x": _integral(speed * np.cos(theta), time),
        "y": _integral(speed * np.sin(theta), time),
        "theta": theta,
        "w": rate,
    }

    def instead(name: str) -> Callable[[Floats, Floats], Floats]:
        return lambda since, values: values + np.interp(since + CHANGE, time, moved[name] - truth[name])

    recording = edited(recording, "poses", x=instead("x"), y=instead("y"), theta=instead("theta"))
    return edited(recording, "gyro", yaw_rate=instead("w"))


def _integral(rate: Floats, time: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])


def held(since: Floats, values: Floats) -> Floats:
    """Values that stay what they were when it changed."""
    return np.where(since > 0.0, values[np.searchsorted(since, 0.0)], values)


def gone(since: Floats, values: Floats) -> Floats:
    return np.where(since > 0.0, 0.0, values)


def halted(left: bool = True, right: bool = True) -> Recording:
    """A recording in which wheels stop; the poses rest with their noise when both do."""
    recording = edited(
        undisturbed(1).recording,
        "wheels",
        **{f"psi_{side}": gone for side, stops in (("left", left), ("right", right)) if stops},
    )
    random = np.random.default_rng(1)
    for name in ("x", "y", "theta"):
        recording = edited(
            recording,
            "poses",
            **{name: lambda since, v: held(since, v) + (since > 0.0) * random.normal(0.0, 0.003, v.shape)},
        )
    return edited(recording, "gyro", yaw_rate=gone)


def handled(watcher: Watcher, utime: int, channel: str, message: Any) -> list[str]:
    watcher.handle(utime, channel, message)
    return watcher.advance(utime)
