"""Find commands that were recorded and not in force: somebody drove with a joystick, or something stopped the robot.

A multiplexer on the robot decides who drives; a recording holds one of its inputs. A robot with a velocity controller
that is commanded to stand comes to rest, at the slowest by

    |psi(t)| = |psi(0)| exp(-(t - DELAY) / SLOWEST_CONTROLLER),

t [s] since the command to stand, psi [rad/s] the wheels' speeds. One that turns its wheels faster was driven otherwise.
One that stands though it is commanded to drive was stopped. Duties are none of these: without one a robot may roll on,
and with a small one it may stand.
"""

import numpy as np

from cmr.model.command_kinds import DUTY
from cmr.recordings.faults.findings import Finding
from cmr.recordings.lags import SLOWEST_CONTROLLER
from cmr.recordings.recording import Recording
from cmr.recordings.robust import quantile
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal

DELAY = 1.0  # s after which a command has taken effect at the latest
TURNING = 0.1  # of fast driving; a wheel that turns more slowly may be noise
CLEARLY = 0.25  # of the fastest command; with less a wheel may stand
LEAST = 2.0  # s for which wheels must do what they were not commanded to
FAST = 0.99  # quantile of the speeds that is fast driving
SLOWING = 1.0  # s for which a robot may slow down before it stands
LONGEST_PERIOD = 0.5  # s that a reading says something of


def commands_in_force(recording: Recording) -> Finding:
    """Find the commands that were not in force, which are set aside."""
    commands = recording.commands
    driven = stopped = np.zeros(len(commands), np.bool_)
    if len(commands) and len(recording.wheels) and recording.command_kind != DUTY:
        speed = np.max(np.abs([recording.wheels[f"psi_{side}"] for side in ("left", "right")]), axis=0)
        noise = TURNING * quantile(speed, FAST)
        driven, stopped = _driven(recording, speed, noise), _stopped(recording, speed, noise)
    seconds = [float(_periods(recording, commands)[mask].sum()) for mask in (driven, stopped)]
    what = ("it drives although it is commanded to stand", "it stands although it is commanded to drive")
    said = " and ".join(f"for {s:.0f} s {how}" for s, how in zip(seconds, what, strict=True) if s)
    either = driven | stopped
    return Finding(
        "commands_not_in_force",
        int(np.count_nonzero(either)),
        f"Not all commands moved the robot: {said}. Something else drove or stopped it, such as a joystick. The "
        "commands of these times were set aside.",
        {"commands": either} if either.any() else {},
    )


def _driven(recording: Recording, speed: Floats, noise: float) -> Mask:
    """Return which commands to stand are those of a time in which the robot was driven otherwise, shape (n,).

    `speed` [rad/s] is that of the faster wheel at each reading, `noise` [rad/s] what a wheel at rest may show.
    """
    commands, wheels = recording.commands, recording.wheels
    stands = _largest(commands) == 0.0
    begins = np.append(True, stands[1:] != stands[:-1]) | recording.pieces.borders(commands.utime)
    number, first = np.cumsum(begins) - 1, commands.utime[begins]
    stretch = np.searchsorted(first, wheels.utime, side="right") - 1
    since = (wheels.utime - first[stretch]) * SECONDS
    at_first = np.zeros(len(first))
    early = (stretch >= 0) & (since <= DELAY)
    np.maximum.at(at_first, stretch[early], speed[early])
    allowed = at_first[stretch] * np.exp(-np.maximum(since - DELAY, 0.0) / SLOWEST_CONTROLLER) + noise
    fast = (stretch >= 0) & (since > DELAY) & (speed > allowed)
    lasting = np.bincount(stretch[fast], _periods(recording, wheels)[fast], minlength=len(first))
    return np.asarray(stands & (lasting[number] >= LEAST))


def _stopped(recording: Recording, speed: Floats, noise: float) -> Mask:
    """Return which commands to drive are those of a time in which the robot stands, or slows down to it, shape (n,)."""
    commands, wheels = recording.commands, recording.wheels
    asked = _largest(commands)
    at = np.minimum(np.searchsorted(wheels.utime, commands.utime), len(wheels) - 1)
    stands = (asked > CLEARLY * asked.max()) & (speed[at] < noise)
    begins = np.append(True, stands[1:] != stands[:-1]) | recording.pieces.borders(commands.utime)
    number = np.cumsum(begins) - 1
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(stands)) - 1
    lasting = (commands.utime[last] - commands.utime[first]) * SECONDS
    times = commands.utime[stands & (lasting[number] >= LEAST)]
    following = np.append(times, np.iinfo(np.int64).max)[np.searchsorted(times, commands.utime)]
    near = following - commands.utime <= SLOWING / SECONDS
    return np.asarray(near & (asked > 0.0) & ~recording.pieces.borders(commands.utime))


def _largest(commands: Signal) -> Floats:
    """Return the larger of both sides' commands, as a size, shape (n,)."""
    return np.asarray(np.maximum(np.abs(commands["left"]), np.abs(commands["right"])), np.float64)


def _periods(recording: Recording, signal: Signal) -> Floats:
    """Return the time [s] that ends with each sample of a signal, shape (n,): 0 over a pause, and of a gap a part."""
    periods = np.minimum(np.diff(signal.seconds, prepend=0.0), LONGEST_PERIOD)
    return np.where(recording.pieces.borders(signal.utime), 0.0, periods)
