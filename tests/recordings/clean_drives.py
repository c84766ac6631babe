"""Made-up recordings without a fault, of every shape: of the plant, which shares no code with the checks or the model.

What a robot, its sensors and whoever keeps their tables are like is drawn by chance: drives and rests, robots with
duties and with velocity controllers, any sensors at any usual rate, whole drives and drives cut into pieces.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.model.command_kinds import DUTY, VELOCITY, WHEEL_SPEED
from cmr.parameters.file import ParameterFile, Value
from cmr.plant import sensors
from cmr.plant.parameters import TYPICAL, PlantParameters, plant_parameters
from cmr.plant.sensors import Noise, correlated
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal
from tests.reference_plant.drives import SEEN, TURNING, Commands, true_motion, utime
from tests.reference_plant.manoeuvres import (
    RICH_DRIVE_SECONDS,
    Manoeuvre,
    constant,
    figure_eight,
    in_turn,
    multisine,
    rich_drive,
)

SIDES = ("left", "right")
PLANT_STEP = 2e-3  # s
SENT = 50.0  # Hz, at which the robot is really commanded
REST = 2.0  # s at both ends of a drive
LATER, EARLIER = (
    1.5,
    0.3,
)  # s at most after which a sensor begins, and before which it ends; slow robots still roll then
DRIVES = ("figure_eight", "circles", "rich_drive", "straight", "rests", "wandering")
# What a healthy robot may well have; none of it is a fault of a recording.
USUAL_EFFECTS = (
    "turn_slip",
    "travel_reduction",
    "lateral_skid",
    "longitudinal_slip",
    "wheel_radius_asymmetry",
    "gyro_bias",
    "gyro_scale",
    "pose_offset",
)
# The same of a motor without a controller that makes up for it.
OF_MOTORS = ("coulomb_friction", "static_friction", "motor_gain_asymmetry", "battery_sag", "deadband")


@dataclass(frozen=True)
class Tracker:
    """A localisation: its `rate` [Hz], noise [m, rad] that lasts `memory` [s], and the `grid` [m, rad] it rounds to."""

    rate: float
    position: float
    heading: float
    memory: float = 0.0
    grid: float = 0.0


TRACKERS = (
    Tracker(100.0, 0.0005, 0.002),  # motion capture
    Tracker(200.0, 0.001, 0.003, grid=0.001),
    Tracker(30.0, 0.004, 0.006, 0.1),  # tags seen by a camera
    Tracker(25.0, 0.005, 0.005, 0.1),
    Tracker(10.0, 0.02, 0.01),  # lidar
    Tracker(7.0, 0.03, 0.02, 0.3),
    Tracker(5.0, 0.05, 0.02, grid=0.001),
)


@dataclass(frozen=True)
class Robot:
    """A robot: the plant's parameters, and the kind of its commands."""

    plant: Mapping[str, float]
    kind: str

    @property
    def parameters(self) -> PlantParameters:
        """All parameters of the plant."""
        return plant_parameters(self.plant)


@dataclass(frozen=True)
class Shape:
    """What a recording is like. `rates` [Hz] by signal, 0 of what was not recorded.

    `lengths` [s] are those of the shortest and the longest piece, none of a drive recorded as a whole. `pause` [s] lies
    between pieces on the recording's clock. The poses of a piece are in `frame`: "world", or its "own". `counters`
    tells how wheel counters go on over a pause: as the wheels turned ("driven"), as if they had not ("held"), or from 0
    ("zero"). `psi` tells whether a wheel's speed is that of the "moment", or the "mean" since the reading before.
    `ticks` are those of a turn of a wheel. `jitter` is the share of an interval by which time stamps are uneven.
    `tells_duty`: the wheels' messages tell the duty in force, as our driver's do.
    """

    drive: str
    robot: Robot
    rates: Mapping[str, float]
    tracker: Tracker
    lengths: tuple[()] | tuple[float, float]
    pause: float
    frame: str
    counters: str
    psi: str
    ticks: float
    jitter: float
    tells_duty: bool


def clean_drive(seed: int) -> tuple[Shape, Recording]:
    """Return a recording without a fault, and its shape; the same seed gives the same one."""
    random = np.random.default_rng([seed, 20])
    shape = _shape(DRIVES[seed % len(DRIVES)], random)
    return shape, recorded(shape, seed)


def _shape(drive: str, random: np.random.Generator) -> Shape:
    robot = _robot(random)
    tracker = TRACKERS[random.integers(len(TRACKERS))]
    has = random.random(4) < (0.8, 0.75, 0.6, 0.9)
    if not has[0] and not has[1]:  # nothing tells what drove the robot
        has[0] = True
    if not has[2] and not has[3]:
        has[3] = True
    rates = {
        "commands": has[0] * float(random.choice([5.0, 10.0, 20.0, 50.0])),
        "wheels": has[1] * float(random.choice([10.0, 20.0, 50.0, 100.0])),
        "gyro": has[2] * float(random.choice([20.0, 50.0, 100.0, 200.0])),
        "poses": has[3] * tracker.rate,
    }
    equal = float(random.integers(2, 11))
    lengths = ((), (), (equal, equal), (2.0, 10.0), (2.0, 4.0))[random.integers(5)]
    return Shape(
        drive,
        robot,
        rates,
        tracker,
        lengths,
        pause=float(random.choice([1.0, 5.0, 30.0, 3600.0])),
        frame=str(random.choice(["world", "own"])),
        counters=str(random.choice(["driven", "held", "zero"])),
        psi=str(random.choice(["moment", "mean"])),
        ticks=float(random.choice([200.0, 480.0, 4096.0, 65536.0])),
        jitter=float(random.choice([0.0, 0.1, 0.3])),
        tells_duty=robot.kind == DUTY and random.random() < 0.5,
    )


def _robot(random: np.random.Generator) -> Robot:
    """Return a robot of some size, by chance with a few of the usual effects."""
    radius, width, fastest = ((0.04, 0.161, 0.74), (0.033, 0.16, 0.22), (0.1, 0.4, 1.2), (0.165, 0.55, 1.0))[
        random.integers(4)
    ]
    k1 = radius / fastest
    plant = {"wheel_radius": radius, "base_width": width, "k1": k1}
    kind = str(random.choice([DUTY, DUTY, VELOCITY, WHEEL_SPEED]))
    if kind == DUTY:
        plant["k2_over_k3"] = 1.0 / (float(random.uniform(0.06, 0.3)) * k1)
    else:
        plant |= {
            "controller_response_time": float(random.choice([0.05, 0.15, 0.3, 0.6, 1.0])),
            "controller_scale": float(random.uniform(0.9, 1.1)),
            "command_delay": float(random.choice([0.0, 0.05, 0.15])),
        }
    possible = USUAL_EFFECTS + (OF_MOTORS if kind == DUTY else ())
    for name in random.choice(possible, int(random.integers(0, 5)), replace=False):
        plant |= _scaled(TYPICAL[name], plant)
    return Robot(plant, kind)


def _scaled(effect: Mapping[str, float], plant: Mapping[str, float]) -> dict[str, float]:
    """Return a typical effect; friction in proportion to the robot's acceleration, not that of the paper's robot."""
    share = plant.get("k2_over_k3", 118.0) / 118.0
    return {name: value * share if name.endswith("friction") else value for name, value in effect.items()}


class Truth:
    """The true motion, as far as something is recorded of it."""

    def __init__(self, states: Mapping[str, Floats], time: Floats) -> None:
        self._states, self._time = states, time

    def at(self, time: Floats, name: str) -> Floats:
        """Return a column of the plant's state at these times [s]."""
        return np.interp(time, self._time, self._states[name])


def recorded(shape: Shape, seed: int) -> Recording:
    """Return a recording of this shape."""
    random = np.random.default_rng([seed, 21])
    p = shape.robot.parameters
    manoeuvre, seconds = _manoeuvre(shape.drive, p, random)
    sent_at = np.arange(round(seconds * SENT)) / SENT
    sent = Commands(sent_at, *manoeuvre(sent_at))
    pieces = _pieces(shape, seconds, random)
    times = {name: _times(rate, pieces, shape.jitter, random) for name, rate in shape.rates.items()}
    if not shape.lengths:
        times = _not_all_at_once(times, seconds, np.random.default_rng([seed, 22]))
    asked = np.unique(np.concatenate([*times.values(), _before(times["wheels"], shape)]))
    noise = Noise(torque=0.3, slip=0.003)
    truth = Truth(true_motion(sent, shape.robot.plant, asked, step=PLANT_STEP, noise=noise, seed=seed), asked)
    signals: dict[str, Signal] = {
        "wheels": _wheels(shape, truth, sent, times["wheels"], pieces, random),
        "gyro": _gyro(p, truth, times["gyro"], random),
        "poses": _poses(shape, truth, times["poses"], pieces, random),
        **_commands(shape, sent, pieces),
    }
    moved: dict[str, Any] = {name: _moved(signal, pieces, shape.pause) for name, signal in signals.items()}
    known = {"wheel_radius": Value(p.wheel_radius), "base_width": Value(p.base_width)}
    return Recording(0, **moved, parameters=ParameterFile(0, known))


def _manoeuvre(drive: str, p: PlantParameters, random: np.random.Generator) -> tuple[Manoeuvre, float]:
    """Return the duties of a drive between two rests, and how long [s] it takes."""
    if drive == "rich_drive":
        return rich_drive(), RICH_DRIVE_SECONDS
    if drive == "figure_eight":
        laps = int(random.integers(1, 5))
        speed = float(random.uniform(0.3, 0.6)) * p.wheel_radius / p.k1
        return figure_eight(30.0 * laps, laps, speed, p), 30.0 * laps
    rest = (REST, constant(0.0, 0.0))
    parts = [rest]
    left = float(random.uniform(30.0, 200.0))
    while left > 0.0:
        part = _part(drive, random)
        parts += [part, (float(random.uniform(0.5, 4.0)), constant(0.0, 0.0))] if drive == "rests" else [part]
        left -= part[0]
    parts.append((REST + 2.0 * p.controller_response_time, constant(0.0, 0.0)))  # until slow robots stand, too
    return in_turn(parts), sum(duration for duration, _ in parts)


def _part(drive: str, random: np.random.Generator) -> tuple[float, Manoeuvre]:
    """Return a part of a drive and how long [s] it takes."""
    duty, sign = float(random.uniform(0.25, 0.8)), float(random.choice([-1.0, 1.0]))
    if drive == "circles":
        inner = duty * float(random.uniform(0.2, 0.9))
        return float(random.uniform(5.0, 20.0)), constant(*((inner, duty) if sign > 0.0 else (duty, inner)))
    if drive == "straight":
        return float(random.uniform(2.0, 8.0)), constant(sign * duty, sign * duty)
    if random.random() < 0.2:
        return 5.0, multisine(sign, 1.0, 0.6)
    sizes = random.uniform(0.2, 0.9, 2) * random.choice([-1.0, 1.0, 1.0], 2)
    return float(random.uniform(0.7, 3.0)), constant(*sizes.tolist())


@dataclass(frozen=True)
class Pieces:
    """When each piece begins and how long it lasts [s] in the drive, each of shape (k,)."""

    begin: Floats
    length: Floats


def _pieces(shape: Shape, seconds: float, random: np.random.Generator) -> Pieces:
    """Cut pieces out of a drive; between them the robot drives on unseen."""
    if not shape.lengths:
        return Pieces(np.zeros(1), np.full(1, seconds))
    begins, lengths, now = [], [], float(random.uniform(1.0, 4.0))
    while now + shape.lengths[0] < seconds:
        length = min(float(random.uniform(*shape.lengths)), seconds - now)
        begins.append(now)
        lengths.append(length)
        now += length + float(random.uniform(0.3, 2.0))
    return Pieces(np.array(begins), np.array(lengths))


def _times(rate: float, pieces: Pieces, jitter: float, random: np.random.Generator) -> Floats:
    """Return when a sensor tells something: at its rate, uneven by this share of an interval, within the pieces."""
    if not rate:
        return np.empty(0)
    end = float(pieces.begin[-1] + pieces.length[-1])
    number = np.arange(1, int(end * rate))
    time = (number + random.random() + jitter * random.uniform(-0.5, 0.5, len(number))) / rate
    return time[_within(time, pieces)]


def _not_all_at_once(times: Mapping[str, Floats], seconds: float, random: np.random.Generator) -> dict[str, Floats]:
    """Have each sensor begin a little after the recording, and end a little before it."""
    begins, ends = LATER * random.random(len(times)), seconds - EARLIER * random.random(len(times))
    return {
        name: time[(time > begin) & (time < end)]
        for (name, time), begin, end in zip(times.items(), begins, ends, strict=True)
    }


def _within(time: Floats, pieces: Pieces) -> NDArray[np.bool_]:
    """Tell which times [s] lie in a piece."""
    number = _piece_of(time, pieces)
    return np.asarray((number >= 0) & (time < pieces.begin[number] + pieces.length[number]))


def _piece_of(time: Floats, pieces: Pieces) -> NDArray[np.int64]:
    return np.searchsorted(pieces.begin, time, side="right") - 1


def _begins(time: Floats, pieces: Pieces) -> NDArray[np.bool_]:
    """Tell which samples are the first of their piece."""
    return np.diff(_piece_of(time, pieces), prepend=-1) > 0


def _moved(signal: Signal, pieces: Pieces, pause: float) -> Signal:
    """Return a signal, timed as in the drive, on the clock of the recording, where pieces lie a pause apart."""
    begins = np.append(0.0, np.cumsum(pieces.length + pause)[:-1])
    time = signal.seconds + (signal.utime[0] - utime(np.zeros(1))[0]) * 1e-6 if len(signal) else np.empty(0)
    number = _piece_of(time + 1e-6, pieces)
    return Signal(utime(time - pieces.begin[number] + begins[number]), signal.fields)


def _before(time: Floats, shape: Shape) -> Floats:
    """Return when the reading before each of the wheels was taken, recorded or not."""
    return np.maximum(time - 1.0 / (shape.rates["wheels"] or 1.0), 0.0)


def _wheels(
    shape: Shape, truth: Truth, sent: Commands, time: Floats, pieces: Pieces, random: np.random.Generator
) -> Signal:
    begins = _begins(time, pieces)
    rad = 2.0 * math.pi / shape.ticks
    fields: dict[str, Floats] = {}
    in_force = np.maximum(np.searchsorted(sent.time, time, side="right") - 1, 0)
    for side in SIDES:
        phase = float(random.random())
        now, before = (np.floor(truth.at(at, f"phi_{side}") / rad + phase) for at in (time, _before(time, shape)))
        mean = (now - before) * rad / np.maximum(time - _before(time, shape), 1e-6)
        fields[f"psi_{side}"] = truth.at(time, f"psi_{side}") if shape.psi == "moment" else mean
        fields[f"ticks_{side}"] = _counters(now, begins, shape.counters)
        fields[f"applied_{side}"] = getattr(sent, side)[in_force] if shape.tells_duty else np.full(len(time), np.nan)
    return Signal(utime(time), fields)


def _counters(ticks: Floats, begins: NDArray[np.bool_], how: str) -> Floats:
    """Return a counter as it goes on over the pauses between pieces; `begins` marks the first readings after them."""
    if how == "driven" or not len(ticks):
        return ticks
    steps = np.where(begins, 0.0, np.diff(ticks, prepend=ticks[0]))
    held = np.cumsum(steps)
    piece = np.cumsum(begins) - 1
    return held if how == "held" else held - held[begins][piece]


def _gyro(p: PlantParameters, truth: Truth, time: Floats, random: np.random.Generator) -> Signal:
    noise = Noise(gyro=0.005)
    rate = sensors.gyro(p, time, [truth.at(time, name) for name in TURNING], noise, random)
    return Signal(utime(time), {"yaw_rate": rate})


def _poses(shape: Shape, truth: Truth, time: Floats, pieces: Pieces, random: np.random.Generator) -> Signal:
    tracker = shape.tracker
    x, y, theta = sensors.seen(shape.robot.parameters, *(truth.at(time, name) for name in SEEN))
    x, y, theta = (
        value + size * correlated(time, tracker.memory, random)
        for value, size in ((x, tracker.position), (y, tracker.position), (theta, tracker.heading))
    )
    if shape.frame == "own" and len(time):
        first = np.flatnonzero(_begins(time, pieces))[np.cumsum(_begins(time, pieces)) - 1]
        place = (x + 1j * y - (x + 1j * y)[first]) * np.exp(-1j * theta[first])
        x, y, theta = place.real, place.imag, theta - theta[first]
    if tracker.grid:
        x, y, theta = (np.round(value / tracker.grid) * tracker.grid for value in (x, y, theta))
    return Signal(utime(time), {"x": x, "y": y, "theta": np.remainder(theta + math.pi, 2.0 * math.pi) - math.pi})


def _commands(shape: Shape, sent: Commands, pieces: Pieces) -> dict[str, Signal]:
    """Return the commands by the name of their signal, as often as they are recorded: every so many-th."""
    every = round(SENT / shape.rates["commands"]) if shape.rates["commands"] else len(sent.time) + 1
    kept = np.arange(every - 1, len(sent.time), every)
    kept = kept[_within(sent.time[kept], pieces)]
    when, left, right = utime(sent.time[kept]), sent.left[kept], sent.right[kept]
    if shape.robot.kind == DUTY:
        return {"commands": Signal(when, {"left": left, "right": right})}
    p = shape.robot.parameters
    none = Signal(when[:0], {"left": np.empty(0), "right": np.empty(0)})
    if shape.robot.kind == WHEEL_SPEED:
        speeds = Signal(when, {"psi_left": left / p.k1, "psi_right": right / p.k1})
        return {"commands": none, "wheel_speed_commands": speeds}
    forward, turn = 0.5 * (left + right), (right - left) / p.base_width
    velocity = Signal(when, {"v": forward * p.wheel_radius / p.k1, "omega": turn * p.wheel_radius / p.k1})
    return {"commands": none, "velocity_commands": velocity}
