"""What the wheels tell of themselves: absurd readings, counters that start anew, encoders that stand still."""

import numpy as np

from cmr.recordings.findings import Finding, counted
from cmr.recordings.recording import Recording
from cmr.recordings.robust import quantile, ratio, running_median
from cmr.recordings.signal import SECONDS, Floats, Mask, Times

SIDES = ("left", "right")
FAST = 0.9  # quantile of the moving speeds that counts as fast driving
ABSURD = 3.0  # times fast driving; a single reading off by more is absurd
FEWEST = 20  # moving samples; fewer do not tell what is fast
AROUND = 2  # readings on either side; as many absurd ones in a row are seen
STUCK = 1.0  # s for which an encoder must stand still though its motor is driven
DRIVEN = 0.8  # of the duty at which a wheel usually turns; with more it should
MOVING = 0.05  # of fast driving; with less a wheel rests
MOVED, TURNED = 0.1, 0.5  # m, rad; a path that extends less far may be noise
PATH_HALF = 5  # neighbours on either side, of which the median is taken for that
LATE_START = 5.0  # s of rest at the beginning
ENDING = 0.3  # s at the end over which the last speed is averaged
STILL_DRIVING = 0.2  # of fast driving; a recording that ends faster was cut off


def wheel_findings(recording: Recording) -> list[Finding]:
    """Find what is wrong with the encoders."""
    wheels = recording.wheels
    anew, (absurd, stuck, dead) = 0, np.zeros((3, len(wheels)), np.bool_)
    dt = np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
    # After a gap the counters have gone on, by speeds that nobody saw.
    longer = np.maximum(1.0, dt / max(quantile(dt[1:], 0.5), SECONDS))
    for side in SIDES:
        speed = wheels[f"psi_{side}"]
        ticks = np.diff(wheels[f"ticks_{side}"], prepend=wheels[f"ticks_{side}"][:1])
        absurd |= _stands_out(speed)
        off = ticks - ratio(ticks, speed * dt) * speed * dt
        wild = np.abs(off) > ABSURD * _fast(ticks) * longer
        back = np.append(wild[1:] & (np.abs(off[1:] + off[:-1]) < 0.5 * np.abs(off[1:])), False) & wild
        absurd |= back
        anew += int(np.count_nonzero(wild & ~back & ~np.append(False, back[:-1]) & ~absurd))
        still = _stuck(recording, side, ticks)
        stuck |= still
        dead |= _dead(still, ticks)
    return [
        Finding(
            "encoder_spikes",
            int(np.count_nonzero(absurd)),
            f"{counted(int(np.count_nonzero(absurd)), 'absurd encoder reading')}: set aside.",
            {"wheels": absurd} if absurd.any() else {},
        ),
        Finding("encoder_resets", anew, f"The encoders' counters start anew {counted(anew, 'time')}; speeds are used."),
        Finding(
            "encoder_stuck",
            int(np.count_nonzero(stuck)),
            f"An encoder stands still for {float(dt[stuck].sum()):.1f} s while its motor is driven and the other side "
            f"turns: encoder, cable or motor.{' From there on its readings are set aside.' if dead.any() else ''}",
            {"wheels": dead} if dead.any() else {},
        ),
    ]


def dead_sensors(recording: Recording) -> Finding:
    """Find wheels and gyro that always say the same though the robot moves: by the others, or by its path."""
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
        f"The {names} always say the same though the robot moves: set aside.",
        {name: np.ones(len(recording.signals[name]), np.bool_) for name, is_dead in dead.items() if is_dead},
    )


def motion_findings(recording: Recording) -> list[Finding]:
    """Tell whether and when the robot moves."""
    utime, speed = _speed(recording)
    fast = _fast(speed)
    moving = speed > MOVING * fast
    never = not moving.any() and _path_extent(recording)[0] <= MOVED
    rest = float((utime[moving][0] - utime[0]) * SECONDS) if moving.any() else 0.0
    ending = speed[utime > utime[-1] - ENDING / SECONDS] if len(utime) else speed
    cut = int(moving.any() and float(np.mean(ending)) > STILL_DRIVING * fast)
    return [
        Finding("never_moved", int(never), "The robot never moves in this recording."),
        Finding("late_start", int(rest > LATE_START), f"The robot rests for the first {rest:.1f} s."),
        Finding("cut_off", cut, "The recording ends while the robot is being driven."),
    ]


def _path_extent(recording: Recording) -> tuple[float, float]:
    """Return how far apart [m] and how differently turned [rad] two poses of the path are; outliers do not count."""
    poses = recording.poses
    if len(poses) < FEWEST:
        return 0.0, 0.0
    x, y, theta = (running_median(values, PATH_HALF) for values in (poses["x"], poses["y"], np.unwrap(poses["theta"])))
    return float(max(np.ptp(x), np.ptp(y))), float(np.ptp(theta))


def _speed(recording: Recording) -> tuple[Times, Floats]:
    """Return times [us] and how fast both wheels turn together, or are told to."""
    if len(recording.wheels):
        signal, names = recording.wheels, ("psi_left", "psi_right")
    else:
        signal, names = recording.commands, ("left", "right")
    return signal.utime, sum((np.abs(signal[name]) for name in names), np.zeros(len(signal)))


def _fast(values: Floats) -> float:
    """Return the size of fast driving; infinite where too little moves to tell."""
    sizes = np.abs(values[values != 0.0])
    return quantile(sizes, FAST) if len(sizes) >= FEWEST else np.inf


def _stands_out(speed: Floats) -> Mask:
    """Tell which readings are absurd beside their neighbours."""
    if len(speed) <= 2 * AROUND:
        return np.zeros(len(speed), np.bool_)
    return np.asarray(np.abs(speed - running_median(speed, AROUND)) > ABSURD * _fast(speed))


def _stuck(recording: Recording, side: str, ticks: Floats) -> Mask:
    """Tell when the encoder of one side stands still though its motor is driven and the other side turns."""
    wheels, duty = recording.wheels, recording.duty
    none = np.zeros(len(wheels), np.bool_)
    other = wheels[f"psi_{'left' if side == 'right' else 'right'}"] != 0.0
    if not len(duty) or not other.any():
        return none
    at = np.searchsorted(duty.utime, wheels.utime, side="right") - 1
    sizes = {name: np.where(at >= 0, np.abs(duty[name][np.maximum(at, 0)]), 0.0) for name in SIDES}
    turning = ticks != 0.0
    usual = sizes[side][turning] if turning.any() else sizes["left" if side == "right" else "right"][other]
    silent = ~turning & other & (sizes[side] > DRIVEN * float(np.median(usual))) & (sizes[side] > 0.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], silent, [False]]).astype(np.int8)))
    for first, end in edges.reshape(-1, 2):
        if (wheels.utime[end - 1] - wheels.utime[first]) * SECONDS >= STUCK:
            none[first:end] = True
    return none


def _dead(stuck: Mask, ticks: Floats) -> Mask:
    """Tell which readings belong to an encoder that was stuck and never spoke again, or had not spoken before."""
    spoke = np.flatnonzero(ticks)
    dead = np.zeros(len(stuck), np.bool_)
    if not stuck.any():
        return dead
    first, last = (int(spoke[0]), int(spoke[-1]) + 1) if len(spoke) else (len(stuck), len(stuck))
    dead[:first] = stuck[:first].any()
    dead[last:] = stuck[last:].any()
    return dead
