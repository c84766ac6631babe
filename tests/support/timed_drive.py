"""Recordings with times as they really come: stamps, a driver's loop and its ramp, adapters that hold replies.

Commands are published by a loop that is sometimes held up, reach the driver a little later or never, and wait there for
its next turn. The driver follows them by a ramp, rounds what it sends, and tells with each feedback what it believes to
be in force, since when, and the encoders. The motion is that of tests.reference_plant; so is what is hidden between
driver and motors: command_delay, command_jitter, and command_loss of single messages to the controller.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.parameters.file import ParameterFile, Value
from cmr.plant import sensors
from cmr.plant.parameters import plant_parameters
from cmr.plant.sensors import Noise
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Mask, Signal, Times
from tests.reference_plant.drives import SEEN, Commands, raster, true_motion, utime
from tests.reference_plant.manoeuvres import RICH_DRIVE_SECONDS, Manoeuvre, in_turn, rich_drive

STEP = 1e-3  # s of the plant
NOISE = Noise(torque=0.2, ticks_per_turn=2048.0, gyro=0.005, position=0.003, heading=math.radians(0.3))
TICKS = 2048.0
GYRO_RATE, POSE_RATE = 100.0, 50.0  # Hz
SPEEDING_UP, SLOWING_DOWN = 10.0, 20.0  # duty/s
HELD_UP = 0.03  # s, mean of what a busy machine holds up a process


@dataclass(frozen=True)
class Chain:
    """What lies between the decision and the motors; times in s, rates in Hz, shares of 1.

    `late` is the mean time that a command takes to the driver. `lost` is the share of commands that never reach it.
    Adapters hold each reply for up to `hold`. `busy` is the share of turns, of any process, that are held up.
    `resolution` is the least duty that the controller reports apart.
    """

    rate: float = 50.0
    driver_rate: float = 100.0
    late: float = 4e-4
    lost: float = 0.0
    hold: float = 0.0
    busy: float = 0.0
    resolution: float = 1.0 / 32767.0
    wire: float = 1.5e-3
    tells_when: bool = True


@dataclass(frozen=True)
class TimedDrive:
    """A recording, and the truth: how late [s] each command that was served took effect, and which were lost."""

    recording: Recording
    lateness: Floats
    lost: Mask


def timed_drive(
    chain: Chain,
    hidden: Mapping[str, float],
    seed: int,
    seconds: float = RICH_DRIVE_SECONDS,
    drive: Manoeuvre | None = None,
) -> TimedDrive:
    """Drive the plant with `hidden` parameters through the chain, the rich drive again and again by default."""
    random = np.random.default_rng(seed)
    repeats = math.ceil(seconds / RICH_DRIVE_SECONDS)
    manoeuvre = drive or in_turn([(RICH_DRIVE_SECONDS, rich_drive())] * repeats)
    stamps = _turns(seconds, chain.rate, chain.busy, random)
    duties = np.column_stack(manoeuvre(stamps))
    lost = random.random(len(stamps)) < chain.lost
    arrivals = stamps + random.exponential(chain.late, len(stamps))
    arrivals = np.maximum.accumulate(np.where(lost, 0.0, arrivals))  # one bus, in order
    turns = _turns(seconds, chain.driver_rate * (1.0 + 1e-3 * random.standard_normal()), chain.busy, random)
    held = chain.hold * random.random((len(turns), 2))
    effect = turns + chain.wire
    read = effect + held[:, 0] + chain.wire
    stamped = read + 0.5 * held[:, 1]
    fresh = stamped[:-1] < turns[1:]  # a turn that was held up for longer leaves no time for the next
    keep = np.append(fresh, True) & (stamped < seconds)
    turns, effect, read, stamped, held = turns[keep], effect[keep], read[keep], stamped[keep], held[keep]
    newest = np.searchsorted(arrivals, turns, side="right") - 1
    newest = _not_lost(newest, lost)
    sent = _ramped(turns, np.where(newest[:, None] >= 0, duties[newest], 0.0), chain.resolution)
    recording = _recorded(
        hidden,
        random,
        seconds=seconds,
        commands=Signal(utime(stamps), {"left": duties[:, 0], "right": duties[:, 1]}),
        sent=Commands(effect, sent[:, 0], sent[:, 1]),
        read=(read, stamped),
        applied_utime=utime(effect + 0.5 * held[:, 0]) * chain.tells_when,
    )
    first = np.flatnonzero(np.diff(newest, prepend=-1) > 0)
    return TimedDrive(recording, effect[first] - stamps[newest[first]], lost)


def _turns(seconds: float, rate: float, busy: float, random: np.random.Generator) -> Floats:
    """Return when a loop turns [s]: at its rate, a little late, and sometimes held up for long."""
    due = np.arange(int(seconds * rate)) / rate + random.random() / rate
    late = random.exponential(2e-4, len(due)) + np.where(
        random.random(len(due)) < busy, random.exponential(HELD_UP, len(due)), 0.0
    )
    for k in range(1, len(due)):  # what comes too late goes on from there
        late[k] = max(late[k], due[k - 1] + late[k - 1] + 2e-4 - due[k])
    return due + late


def _not_lost(newest: NDArray[np.int64], lost: Mask) -> NDArray[np.int64]:
    """Return the newest command that was not lost."""
    last_there = np.maximum.accumulate(np.where(lost, -1, np.arange(len(lost))))
    return np.where(newest >= 0, last_there[newest], -1)


def _ramped(turns: Floats, wanted: Floats, resolution: float) -> Floats:
    """Return the duties that follow those wanted, none faster than it may, as the controller rounds them."""
    sent, last = np.zeros_like(wanted), np.zeros(2)
    for k, want in enumerate(wanted):
        seconds = turns[k] - turns[k - 1] if k else 0.0
        for side in range(2):
            grows = abs(want[side]) >= abs(last[side]) and want[side] * last[side] >= 0.0
            most = (SPEEDING_UP if grows else SLOWING_DOWN) * min(seconds, 0.02)
            last[side] += min(max(want[side] - last[side], -most), most)
        sent[k] = np.rint(last / resolution) * resolution
    return sent


def _recorded(
    hidden: Mapping[str, float],
    random: np.random.Generator,
    *,
    seconds: float,
    commands: Signal,
    sent: Commands,
    read: tuple[Floats, Floats],
    applied_utime: Times,
) -> Recording:
    p = plant_parameters(hidden)
    read_at, stamped = read
    gyro_time, pose_time = raster(seconds, GYRO_RATE)[1:], raster(seconds, POSE_RATE)
    asked = np.concatenate([read_at, gyro_time, sensors.pose_time(p, pose_time)])
    states = true_motion(sent, hidden, asked, step=STEP, noise=NOISE, seed=int(random.integers(2**31)))
    wheels, gyro, poses = np.split(np.arange(len(asked)), [len(read_at), len(read_at) + len(gyro_time)])
    counts = {
        side: sensors.ticks(p, sign, states[f"phi_{side}"][wheels], TICKS, TICKS, float(random.random()))
        for side, sign in (("left", 1.0), ("right", -1.0))
    }
    # A gyro tells how far it has turned since it told last.
    turned = np.diff(states["theta"][gyro], prepend=0.0) * GYRO_RATE
    pose = [states[name][poses] for name in SEEN]
    seen = sensors.pose(p, pose_time, pose, NOISE, random)
    return Recording(
        0,
        commands=commands,
        wheels=_wheels(stamped, counts, sent, applied_utime),
        gyro=Signal(utime(gyro_time), {"yaw_rate": turned + NOISE.gyro * random.standard_normal(len(turned))}),
        poses=Signal(utime(pose_time), dict(zip(("x", "y", "theta"), seen, strict=True))),
        parameters=ParameterFile(0, {"wheel_radius": Value(p.wheel_radius)}),
    )


def _wheels(stamped: Floats, counts: Mapping[str, Floats], sent: Commands, applied_utime: Times) -> Signal:
    return Signal(
        utime(stamped),
        {
            **{f"ticks_{side}": count for side, count in counts.items()},
            **{f"psi_{side}": sensors.wheel_speed(count, stamped, TICKS) for side, count in counts.items()},
            "applied_left": sent.left,
            "applied_right": sent.right,
            "applied_utime": applied_utime.astype(np.float64),
            "status": np.zeros(len(stamped)),
        },
    )
