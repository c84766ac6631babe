"""Checks of the wheels: absurd readings, counter restarts, encoders that are stuck."""

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.faults.findings import Finding, counted
from cmr.recordings.recording import Recording
from cmr.recordings.robust import quantile, ratio, running_median
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal, Times

SIDES = ("left", "right")
FAST = 0.9  # quantile of moving speeds that counts as fast driving
ABSURD = 3.0  # times fast driving; a single reading beyond is absurd
FEWEST = 20  # moving samples needed to define fast driving
AROUND = 2  # readings on either side; up to this many absurd ones in a row are detected
LONGEST_SPIKE, MOST_STEPS = 5, 8  # readings, and counter steps in them, within which a spike returns
BACK = 0.5  # of the step away; a closer counter has returned
STUCK = 1.0  # s for which an encoder must stand still although its motor is driven
DRIVEN = 0.8  # of the duty at which a wheel usually turns; with more it should turn
MOVING = 0.05  # of fast driving; below it a wheel rests
AT_REST = 0.5  # largest share of readings of a resting wheel that differ from 0
MOVED, TURNED = 0.1, 0.5  # m, rad; a smaller extent of a path may be noise
PATH_HALF = 5  # neighbours on either side for the median
LATE_START = 5.0  # s of rest at the beginning
RESTS = "The robot rests for the first {rest:.1f} s."
ENDING = 0.3  # s at the beginning and the end over which speed is averaged
STILL_DRIVING = 0.2  # of fast driving; a recording that ends faster was cut off


def wheel_findings(recording: Recording) -> list[Finding]:
    """Check the encoders."""
    wheels = recording.wheels
    restarts, (absurd, stuck, dead) = 0, np.zeros((3, len(wheels)), np.bool_)
    dt = np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
    begins = recording.pieces.borders(wheels.utime)
    begins[:1] = True
    for side in SIDES:
        absurd |= _stands_out(wheels[f"psi_{side}"], np.cumsum(begins))
        ticks = np.where(begins, 0.0, np.diff(wheels[f"ticks_{side}"], prepend=wheels[f"ticks_{side}"][:1]))
        wild = _wild(ticks, wheels[f"psi_{side}"] * dt, dt, begins)
        spikes, resets = _spikes_and_resets(wild, begins)
        absurd |= spikes
        restarts += int(np.count_nonzero(resets & ~absurd))
        still = _stuck(recording, side, ticks, begins)
        stuck |= still
        dead |= _dead(still, ticks)
    standing = float(dt[stuck & ~begins].sum())
    return [
        Finding(
            "encoder_spikes",
            int(np.count_nonzero(absurd)),
            f"{counted(int(np.count_nonzero(absurd)), 'absurd encoder reading')}: set aside.",
            {"wheels": absurd} if absurd.any() else {},
        ),
        Finding(
            "encoder_resets",
            restarts,
            f"A wheel's counter jumps {counted(restarts, 'time')}, as after a restart; wheel speeds are used instead.",
        ),
        Finding(
            "encoder_stuck",
            int(np.count_nonzero(stuck)),
            f"An encoder stands still for {standing:.1f} s while its motor is driven and the "
            f"other side turns: encoder, cable or motor."
            f"{' From there on its readings are set aside.' if dead.any() else ''}",
            {"wheels": dead} if dead.any() else {},
        ),
    ]


def dead_sensors(recording: Recording) -> Finding:
    """Find wheels and a gyro with constant readings although the robot moves, by the others or by its path."""
    wheels, gyro = recording.wheels, recording.gyro
    turning = np.count_nonzero(wheels["psi_left"] != wheels["psi_right"]) >= FEWEST
    far, round_about = _path_extent(recording)
    dead = {
        "wheels": len(wheels) >= FEWEST
        and not (np.any(wheels["psi_left"]) or np.any(wheels["psi_right"]))
        and far > MOVED,
        "gyro": len(gyro) >= FEWEST
        and bool(np.all(gyro["yaw_rate"] == gyro["yaw_rate"][0]))
        and (turning or round_about > TURNED),
    }
    names = " and ".join(name for name, is_dead in dead.items() if is_dead)
    return Finding(
        "dead_sensors",
        sum(map(int, dead.values())),
        f"The readings of the {names} never change though the robot moves: set aside.",
        {name: np.ones(len(recording.signals[name]), np.bool_) for name, is_dead in dead.items() if is_dead},
    )


def motion_findings(recording: Recording) -> list[Finding]:
    """Report whether and when the robot moves.

    A recording in pieces, or one that begins in motion, was cut out of a drive, so an end in motion is no finding.
    """
    utime, speed = _speed(recording)
    seconds, fast = recording.pieces.seconds(utime), _fast(speed)
    moving = motion_of(recording)
    never = moving is None and _seen_at_rest(recording, speed)
    rest = float(recording.pieces.seconds(np.array([moving[0]]))[0] - seconds[0]) if moving else 0.0
    near = seconds < seconds[:1] + ENDING, seconds > seconds[-1:] - ENDING
    beginning, ending = (float(np.mean(speed[at])) if len(utime) else 0.0 for at in near)
    cut = len(recording.pieces) == 1 and beginning <= MOVING * fast and ending > STILL_DRIVING * fast
    cut = cut and not _told_to_stop(recording.duty)  # a robot that is slow to stop still rolls
    return [
        Finding("never_moved", int(never), "The robot never moves in this recording."),
        Finding("late_start", int(rest > LATE_START), RESTS.format(rest=rest)),
        Finding("cut_off", int(cut), "The recording ends while the robot still moves."),
    ]


def _seen_at_rest(recording: Recording, speed: Floats) -> bool:
    """Return whether wheels, or else commands, and the path show a robot at rest.

    Too few readings to define fast driving may all be of a moving robot.
    """
    shown = len(speed) > 0 or len(recording.poses) >= FEWEST
    few = len(speed) > 0 and float(np.mean(speed != 0.0)) > AT_REST
    return shown and not few and _path_extent(recording)[0] <= MOVED


def _told_to_stop(duty: Signal) -> bool:
    """Return whether the last commands are to rest."""
    last = duty.seconds > duty.seconds[-1:] - ENDING
    return bool(len(duty)) and not any(np.any(duty[side][last]) for side in SIDES)


def motion_of(recording: Recording) -> tuple[int, int] | None:
    """Return when the robot first and last moves [us]; None if it never does."""
    utime, speed = _speed(recording)
    moving = utime[speed > MOVING * _fast(speed)]
    return (int(moving[0]), int(moving[-1])) if len(moving) else None


def _path_extent(recording: Recording) -> tuple[float, float]:
    """Return the largest distance [m] and difference of heading [rad] between poses of the path; robust to outliers."""
    poses = recording.poses
    if len(poses) < FEWEST:
        return 0.0, 0.0
    x, y, theta = (running_median(values, PATH_HALF) for values in (poses["x"], poses["y"], np.unwrap(poses["theta"])))
    return float(max(np.ptp(x), np.ptp(y))), float(np.ptp(theta))


def _speed(recording: Recording) -> tuple[Times, Floats]:
    """Return times [us] and the speed of both wheels together, or the commanded one."""
    if len(recording.wheels):
        signal, names = recording.wheels, ("psi_left", "psi_right")
    else:
        signal, names = recording.commands, ("left", "right")
    return signal.utime, sum((np.abs(signal[name]) for name in names), np.zeros(len(signal)))


def _fast(values: Floats) -> float:
    """Return the size of fast driving; infinite with too little motion."""
    sizes = np.abs(values[values != 0.0])
    return quantile(sizes, FAST) if len(sizes) >= FEWEST else np.inf


def _stands_out(speed: Floats, run: NDArray[np.int64]) -> Mask:
    """Return which readings are absurd compared with their neighbours of the same `run`."""
    if len(speed) <= 2 * AROUND:
        return np.zeros(len(speed), np.bool_)
    return np.asarray(np.abs(speed - running_median(speed, AROUND, run)) > ABSURD * _fast(speed))


def _wild(ticks: Floats, turned: Floats, dt: Floats, begins: Mask) -> Floats:
    """Return the difference between the counters and the wheels' rotation `turned`; 0 within tolerance.

    All have shape (n,), and refer to the time since the previous reading; the first reading of a piece (`begins`) has
    none. During a gap the counters continued, at unrecorded speeds.
    """
    longer = np.maximum(1.0, dt / max(quantile(dt[~begins], 0.5), SECONDS))
    off = np.where(begins, 0.0, ticks - ratio(ticks, np.where(begins, 0.0, turned)) * turned)
    return np.where(np.abs(off) > ABSURD * _fast(ticks) * longer, off, 0.0)


def _spikes_and_resets(wild: Floats, begins: Mask) -> tuple[Mask, Mask]:
    """Return which readings of a counter are absurd, and at which it restarts, each of shape (n,).

    A counter that returns within a few readings has not restarted: the readings in between were absurd, as is the last
    reading of a piece, since it is unknown whether it would have returned.
    """
    spikes, resets = np.zeros((2, len(wild)), np.bool_)
    piece = np.cumsum(begins)
    last = np.append(begins[1:], True)
    at = np.flatnonzero(wild)
    passed = -1
    for k, there in enumerate(at.tolist()):
        if there <= passed:
            continue
        returns = np.cumsum(wild[at[k : k + MOST_STEPS]])
        back = [
            int(other)
            for other, rest in zip(at[k + 1 : k + MOST_STEPS], returns[1:], strict=False)
            if other - there <= LONGEST_SPIKE and piece[other] == piece[there] and abs(rest) < BACK * abs(wild[there])
        ]
        if back:
            spikes[there : back[0]] = True
            passed = back[0]
        elif last[there]:
            spikes[there] = True
        else:
            resets[there] = True
    return spikes, resets


def _stuck(recording: Recording, side: str, ticks: Floats, begins: Mask) -> Mask:
    """Return when one side's encoder stands still although its motor is driven and the other side turns.

    `ticks`, shape (n,), are differences from the previous reading; the first of a piece (`begins`) equals the next.
    """
    wheels, duty = recording.wheels, recording.duty
    none = np.zeros(len(wheels), np.bool_)
    other = wheels[f"psi_{'left' if side == 'right' else 'right'}"] != 0.0
    if not len(duty) or not other.any():
        return none
    at = np.searchsorted(duty.utime, wheels.utime, side="right") - 1
    sizes = {name: np.where(at >= 0, np.abs(duty[name][np.maximum(at, 0)]), 0.0) for name in SIDES}
    turning = np.where(begins, np.roll(ticks, -1), ticks) != 0.0
    usual = sizes[side][turning] if turning.any() else sizes["left" if side == "right" else "right"][other]
    silent = ~turning & other & (sizes[side] > DRIVEN * float(np.median(usual))) & (sizes[side] > 0.0)
    for first, end in _stretches(silent, begins):
        if (wheels.utime[end - 1] - wheels.utime[first]) * SECONDS >= STUCK:
            none[first:end] = True
    return none


def _stretches(marks: Mask, begins: Mask) -> NDArray[np.int64]:
    """Return the first index and end of each stretch of marks within a piece, shape (k, 2)."""
    ahead = np.append(False, marks[:-1]) & ~begins
    behind = np.append(marks[1:] & ~begins[1:], False)
    return np.stack([np.flatnonzero(marks & ~ahead), np.flatnonzero(marks & ~behind) + 1], axis=1)


def _dead(stuck: Mask, ticks: Floats) -> Mask:
    """Return which readings belong to an encoder that was stuck and never worked again, or had not worked before."""
    spoke = np.flatnonzero(ticks)
    dead = np.zeros(len(stuck), np.bool_)
    if not stuck.any():
        return dead
    first, last = (int(spoke[0]), int(spoke[-1]) + 1) if len(spoke) else (len(stuck), len(stuck))
    dead[:first] = stuck[:first].any()
    dead[last:] = stuck[last:].any()
    return dead
