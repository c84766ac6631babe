"""Detect recorded commands that were not in force: somebody drove with a joystick, or something stopped the robot.

A multiplexer on the robot selects who drives; a recording contains only one of its inputs. A robot with a velocity
controller that is commanded to stand comes to rest, at the slowest with

    |psi(t)| = |psi(0)| exp(-(t - DELAY) / SLOWEST_CONTROLLER),

t [s] since the command to stand, psi [rad/s] the wheels' speeds. Faster wheels were driven by something else. A robot
that stands although it is commanded to drive was stopped. This does not apply to duties: without one a robot may coast,
and with a small one it may stand. Pieces shorter than DELAY plus LEAST are not judged.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmr.model.command_kinds import DUTY
from cmr.recordings.faults.findings import Finding
from cmr.recordings.lags import SLOWEST_CONTROLLER, clocks_differ, lags_of
from cmr.recordings.recording import Recording
from cmr.recordings.robust import quantile, running_median
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal

DELAY = 1.0  # s by which a command has certainly taken effect
TURNING = 0.1  # of fast driving; slower rotation may be noise
FAST = 0.9  # quantile of the speeds while the robot is commanded to drive
CLEARLY = 0.25  # of the fastest command; with a smaller one a wheel may stand
NOTHING = 1e-3  # of the fastest command; a smaller one is a command to stand
LEAST = 2.0  # s for which wheels must continuously contradict the command
SLOWING = 1.0  # s for starting and stopping, before and after that
LONGEST_PERIOD, PERIODS = 0.5, 4.0  # s, and usual periods, for which a sample is valid
HALF = 2  # readings on either side for the median
LATEST = 700.0  # time constants; limits the exponent, as infinity times zero is NaN

Numbers = NDArray[np.int64]


def commands_in_force(recording: Recording, rates: Mapping[str, float]) -> Finding:
    """Find commands that were not in force, and exclude them; `rates` [Hz] are those of the signals."""
    driven, stopped = _found(recording)
    if (driven | stopped).any():  # a clock that is far off looks the same
        lag = next((lag for lag in lags_of(recording) if lag.sensor == "wheels"), None)
        if lag is not None and clocks_differ(lag, rates, SLOWEST_CONTROLLER):
            late = round(lag.seconds / SECONDS)
            wheels = replace(recording.wheels, utime=recording.wheels.utime - late)
            driven, stopped = _found(replace(recording, wheels=wheels))
    seconds = [float(_until_next(recording)[mask].sum()) for mask in (driven, stopped)]
    what = ("the robot drove although it was commanded to stand", "it stood although it was commanded to drive")
    said = " and ".join(f"for {s:.0f} s {how}" for s, how in zip(seconds, what, strict=True) if s)
    either = driven | stopped
    return Finding(
        "commands_not_in_force",
        int(np.count_nonzero(either)),
        f"Some commands were not in force: {said}. Something else drove or stopped it, such as a joystick. These "
        "commands were set aside.",
        {"commands": either} if either.any() else {},
    )


def _found(recording: Recording) -> tuple[Mask, Mask]:
    """Return which commands were given while something else drove the robot, and while it was stopped; (n,) each."""
    commands, wheels = recording.commands, recording.wheels
    none = np.zeros(len(commands), np.bool_)
    asked = np.maximum(np.abs(commands["left"]), np.abs(commands["right"])) if len(commands) else np.zeros(0)
    drives = asked > NOTHING * asked.max(initial=0.0)
    if not drives.any() or len(wheels) < 2 or recording.command_kind == DUTY:
        return none, none
    speed = np.max(np.abs([wheels["psi_left"], wheels["psi_right"]]), axis=0)
    speed = running_median(speed, HALF, np.cumsum(recording.pieces.borders(wheels.utime)))
    command, since = _in_force(recording, drives)
    known = command >= 0
    driving = known & drives[command]
    if not driving.any():
        return none, none
    noise = TURNING * quantile(speed[driving], FAST)
    too_fast = known & ~drives[command] & (since > DELAY) & (speed > _allowed(speed, command, since, drives) + noise)
    large = known & (asked[command] > CLEARLY * asked.max()) & (since > DELAY)
    driven = _around(recording, _lasting(recording, too_fast)) & ~drives
    return driven, _around(recording, _lasting(recording, large & (speed < noise))) & drives


def _in_force(recording: Recording, drives: Mask) -> tuple[Numbers, Floats]:
    """Return the number of the command in force at each reading of the wheels, -1 where none is, shape (n,).

    Also return for how long [s] the robot had been commanded to drive, or to stand.
    """
    commands, wheels, pieces = recording.commands, recording.wheels, recording.pieces
    piece = pieces.number(commands.utime)
    number = np.searchsorted(commands.utime, wheels.utime, side="right") - 1
    usual = float(np.median(np.diff(commands.utime))) * SECONDS if len(commands) > 1 else np.inf
    old = (wheels.utime - commands.utime[number]) * SECONDS > max(LONGEST_PERIOD, PERIODS * usual)
    begins = np.append(True, (drives[1:] != drives[:-1]) | (piece[1:] != piece[:-1]))
    first = commands.utime[begins][np.cumsum(begins) - 1]
    since = (wheels.utime - first[number]) * SECONDS
    number[old | (number >= 0) & (piece[number] != pieces.number(wheels.utime))] = -1
    return number, np.asarray(since, np.float64)


def _allowed(speed: Floats, command: Numbers, since: Floats, drives: Mask) -> Floats:
    """Return how fast a wheel may still turn at each reading, (n,), given its speed in the first DELAY."""
    begins = np.append(True, np.diff(drives.astype(np.int8)) != 0)
    stretch = (np.cumsum(begins) - 1)[command]
    at_first = np.full(int(begins.sum()), -np.inf)
    early = (command >= 0) & (since <= DELAY)
    np.maximum.at(at_first, stretch[early], speed[early])
    at_first[np.isinf(at_first)] = np.inf  # for a stretch with an unknown beginning
    time_constants = np.clip((since - DELAY) / SLOWEST_CONTROLLER, 0.0, LATEST)
    return np.asarray(at_first[stretch] * np.exp(-time_constants), np.float64)


def _lasting(recording: Recording, marked: Mask) -> list[tuple[int, int]]:
    """Return first and last time [us] of each run of marked readings that lasts LEAST."""
    utime = recording.wheels.utime
    breaks = np.append(True, np.diff(utime) > LONGEST_PERIOD / SECONDS) | recording.pieces.borders(utime)
    begins = np.flatnonzero(np.append(True, marked[1:] != marked[:-1]) | breaks)
    ends = np.append(begins[1:], len(marked)) - 1
    runs = [(int(utime[a]), int(utime[b])) for a, b in zip(begins, ends, strict=True) if marked[a]]
    return [(first, last) for first, last in runs if last - first >= LEAST / SECONDS]


def _around(recording: Recording, runs: list[tuple[int, int]]) -> Mask:
    """Return which commands belong to these runs, or to the starting or stopping around them; (n,)."""
    utime, pieces = recording.commands.utime, recording.pieces
    piece, slowing = pieces.number(utime), round((DELAY + SLOWING) / SECONDS)
    inside = np.zeros(len(utime), np.bool_)
    for first, last in runs:
        near = (utime >= first - slowing) & (utime <= last + slowing)
        inside |= near & (piece == pieces.number(np.array([first]))[0])
    return inside


def _until_next(recording: Recording) -> Floats:
    """Return the time [s] from each command to the next one, or to the end of its piece, shape (n,)."""
    commands: Signal = recording.commands
    if not len(commands):
        return np.zeros(0)
    following = np.append(commands.utime[1:], np.iinfo(np.int64).max)
    ends = np.minimum(following, recording.pieces.last[recording.pieces.number(commands.utime)])
    return np.asarray((ends - commands.utime) * SECONDS, np.float64)
