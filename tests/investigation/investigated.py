"""A robot of the plant that is driven while it is recorded, and an investigation of it in simulated time."""

import math
import time
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from random import Random

import numpy as np

from cmr.geometry.obstacles import Geofence
from cmr.investigation.calibrating import settled
from cmr.investigation.driving import AtOnce, Deciding, Driving, Place
from cmr.investigation.engine import Investigation
from cmr.investigation.floor import Floor
from cmr.investigation.movements import PERIOD
from cmr.model.catalogue import CATALOGUE
from cmr.model.duty_ramp import Limits
from cmr.parameters.file import ParameterFile, Value
from cmr.plant import sensors
from cmr.plant.beyond_sensors import forward_speed
from cmr.plant.commanded import CommandedRobot
from cmr.plant.parameters import Floats, plant_parameters
from cmr.plant.running import PLACES, STEP, RunningRobot
from cmr.plant.sensors import REALISTIC, Noise
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Signal
from tests.hidden_effects.messy import imperfections
from tests.hidden_effects.robots import draw_nominal, draw_robot
from tests.hidden_effects.sizes import draw_sizes
from tests.reference_plant.drives import NOMINAL_TICKS, utime

FINE = 0.005  # s between two moments of which the truth is kept; wheels and gyro are read at every second one
EVERY, EVERY_POSE = 2, 8  # moments
LONGEST = 100.0  # s
KEPT = ("x", "y", "theta", "w", "phi_left", "phi_right", "psi_left", "psi_right")
SQUARE = Geofence([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
SMALL = Geofence([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
L_SHAPE = Geofence([(-1.0, -1.0), (1.0, -1.0), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (-1.0, 1.0)])
OTHER = (0.55, 0.45)  # m, where another robot stands on a floor of 2 m x 2 m
WRONG = 0.1  # share by which a wheel radius is believed wrong
GONE, STOPPED = (7.0, 10.0), 0.5  # s between which poses are lost; s after which a pilot without poses stops
UNLIMITED = Limits(1e6, 1e6)  # this robot's driver has no ramp
LIMITS = frozenset({"saturation", "current_limit", "slew_limit", "turn_rate_limit", "encoder_quantisation"})
STAYING = ("_time", "_phase", "_x", "_y", "_radius", "_saturation")  # how names end of what has no size
REST, AFTER = 0.4, 5.0  # s before the opening, and after a name
CHANGES_WITHIN = 30.0  # s; changes at a time come in the middle third of it


class DrivenRobot:
    """A robot with these parameters of the plant, at rest at `pose`; the same seed gives the same noise."""

    def __init__(
        self,
        parameters: Mapping[str, float],
        noise: Noise = REALISTIC,
        seed: int = 0,
        pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.parameters = plant_parameters(parameters)
        self._noise = noise
        self._running = RunningRobot(self.parameters, pose, noise.of_motion, seed)
        self._commanded = CommandedRobot(self._running, self.parameters, Random(seed))
        self._truth: list[list[float]] = [self._now()]
        self._commands: list[tuple[float, float, float]] = []
        random = np.random.default_rng([seed, 1])
        count = round(LONGEST / FINE) + 1
        self._phases = random.random(2)
        self._gyro_noise = random.standard_normal((2, count))
        time = np.asarray(np.arange(count) * FINE, np.float64)
        poses = time[::EVERY_POSE]
        self._pose_noise = np.stack([sensors.correlated(poses, noise.pose_time, random) for _ in range(3)])

    @property
    def time(self) -> float:
        """The time since it was switched on [s]."""
        return (len(self._truth) - 1) * FINE

    @property
    def state(self) -> dict[str, float]:
        """The true state by name."""
        return dict(zip(KEPT, self._truth[-1], strict=True))

    @property
    def place(self) -> Place:
        """Where it truly is; its speed is not needed."""
        return Place(self.state["x"], self.state["y"], self.state["theta"], 0.0)

    @property
    def path(self) -> Floats:
        """The true places so far, (n, 2) [m]."""
        return np.array(self._truth)[:, :2]

    def drive(self, left: float, right: float, seconds: float) -> None:
        """Command these duties now, and let the world go on for `seconds`, a multiple of FINE."""
        self._commands.append((self.time, left, right))
        self._commanded.command(left, right)
        for _ in range(round(seconds / FINE)):
            self._commanded.advance(self.time + FINE)
            self._truth.append(self._now())

    def put(self, state: Mapping[str, float]) -> None:
        """Put the robot where another is: its pose, and its wheels as far turned and as fast; by names of KEPT."""
        for name in ("x", "y", "theta", "phi_left", "phi_right", "psi_left", "psi_right"):
            self._running.carried[PLACES[name]] = state[name]
        self._truth[-1] = self._now()

    def recording(self) -> Recording:
        """Return all that was recorded so far."""
        p, noise = self.parameters, self._noise
        truth = dict(zip(KEPT, np.array(self._truth).T, strict=True))
        truth["v"] = forward_speed(p, truth["psi_left"], truth["psi_right"])
        all_times = np.asarray(np.arange(len(self._truth)) * FINE, np.float64)
        time, pose_time = all_times[::EVERY], all_times[::EVERY_POSE]

        def at(name: str, moments: Floats) -> Floats:
            return np.asarray(np.interp(moments, all_times, truth[name]), np.float64)

        seen_at = sensors.gyro_time(p, time)
        # The plant's yaw rate is that in the middle of its last step.
        rate = sensors.rate_seen(p, time, at("w", seen_at + 0.5 * STEP), at("theta", seen_at), at("v", seen_at))
        white, walk = self._gyro_noise[:, : len(time)]
        rate = rate + noise.gyro * white + noise.gyro_walk * np.cumsum(walk) * math.sqrt(FINE * EVERY)
        moments = sensors.pose_time(p, pose_time)
        true = (at(name, moments) for name in ("x", "y", "theta", "v", "w"))
        shown = [sensors.filtered(pose_time, one, p.pose_smoothing) for one in sensors.seen(p, *true)]
        sizes = (noise.position, noise.position, noise.heading)
        x, y, theta = (v + s * n[: len(v)] for v, s, n in zip(shown, sizes, self._pose_noise, strict=True))
        theta = np.remainder(theta + math.pi, 2.0 * math.pi) - math.pi
        sent = np.array(self._commands)
        return Recording(
            0,
            commands=Signal(utime(sent[:, 0]), {"left": sent[:, 1], "right": sent[:, 2]}),
            wheels=self._wheels(time, *(at(f"phi_{side}", sensors.wheel_time(p, time)) for side in ("left", "right"))),
            gyro=Signal(utime(time), {"yaw_rate": rate}),
            poses=Signal(utime(pose_time), {"x": x, "y": y, "theta": theta}),
            parameters=ParameterFile(0, {"wheel_radius": Value(p.wheel_radius)}),
        )

    def _wheels(self, time: Floats, left: Floats, right: Floats) -> Signal:
        p, ticks = self.parameters, self._noise.ticks_per_turn
        fields: dict[str, Floats] = {}
        for name, side, phi, phase in zip(("left", "right"), (1.0, -1.0), (left, right), self._phases, strict=True):
            count = sensors.ticks(p, side, sensors.counted(p, phi, time), ticks, NOMINAL_TICKS, float(phase))
            fields[f"ticks_{name}"] = count
            fields[f"psi_{name}"] = sensors.wheel_speed(count, time, NOMINAL_TICKS)
            fields[f"applied_{name}"] = np.full(len(time), math.nan)
        return Signal(utime(time), fields)

    def _now(self) -> list[float]:
        return [float(self._running.carried[PLACES[name]]) for name in KEPT]


def without_poses(recording: Recording) -> Recording:
    """Return what is recorded of a robot that no tracker sees."""
    return replace(recording, poses=recording.poses.between(0, 0))


class Estimate:
    """Where a robot seems to be by its gyro and its wheels as they read: the gyro's bias turns it away."""

    def __init__(self, driven: DrivenRobot) -> None:
        self._driven, self._place, self._before = driven, driven.place, driven.state
        self._time = driven.time

    def place(self) -> Place:
        """Return the place now."""
        driven, before, now = self._driven, self._before, self._driven.state
        p, seconds = driven.parameters, driven.time - self._time
        turned = (1.0 + p.gyro_scale) * (now["theta"] - before["theta"]) + p.gyro_bias * seconds
        way = 0.5 * p.wheel_radius * sum(now[side] - before[side] for side in ("phi_left", "phi_right"))
        heading = self._place.theta + 0.5 * turned
        x, y = self._place.x + way * math.cos(heading), self._place.y + way * math.sin(heading)
        self._place = Place(x, y, self._place.theta + turned, 0.0)
        self._before, self._time = now, driven.time
        return self._place


@dataclass(frozen=True)
class InvestigatedCase:
    """What is hidden: `effects` of ordinary sizes times `size`, in the robot of this `seed`; how movements come.

    A `messy` robot has six small effects, drawn by its seed, too. Of one that is `unseen` no poses are reported; `lost`
    ones are missing for a while, in which its pilot stops it. The floor is `fence`, with `others` (x, y) [m] that stand
    on it. The wheel radius is `misjudged` by WRONG. To `calibrate` is to end once the robot's own parameters are known.
    """

    effects: tuple[str, ...] = ()
    seed: int = 0
    size: float = 1.0
    at_random: bool = False
    longest: float = 60.0
    messy: bool = False
    unseen: bool = False
    lost: bool = False
    fence: Geofence = SQUARE
    others: tuple[tuple[float, float], ...] = ()
    misjudged: bool = False
    calibrate: bool = False


@dataclass(frozen=True)
class Outcome:
    """What came of it: names with the time [s of driving] at which each was found, and what would not have shown.

    `within` [m] is how far the robot always was inside the floor's border, and from what stands on it, `ended` [s] when
    it was over, `cpu` [s] what its decisions took, `remains` whether something remained that no effect explains.
    `known` are the robot's own parameters, averaged over what may be hidden: value, deviation, truth. `notes`
    are the sentences that it said for people.
    """

    named: Mapping[str, float]
    also: tuple[str, ...]
    not_shown: tuple[str, ...]
    ended: float
    within: float
    sizes: Mapping[str, float]
    cpu: float = field(default=0.0, compare=False)
    problem: str = ""
    remains: bool = False
    known: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


class Timed(AtOnce):
    """A planner that takes no simulated time, and says how much of a processor it took [s]."""

    def __init__(self) -> None:
        super().__init__()
        self.cpu = 0.0

    def begin(self, deciding: Deciding) -> None:
        """Decide."""
        began = time.process_time()
        super().begin(deciding)
        self.cpu += time.process_time() - began


def investigated(case: InvestigatedCase, *, until_named: str = "", tell: bool = False) -> Outcome:
    """Hide what the case says in a robot on its floor, and investigate it until that is over.

    It ends earlier, AFTER seconds of driving after an effect is named, if that effect is `until_named`.
    """
    driven, investigation, sizes = _hidden(case)
    planner = Timed()
    driving = Driving(investigation, lambda: _recorded(case, driven), planner)
    estimate = Estimate(driven)
    driven.drive(0.0, 0.0, REST)
    named: dict[str, float] = {}
    notes, steps = set[str](), 0
    while not driving.finished and driven.time < LONGEST - 1.0:
        if until_named in named and driven.time - REST > named[until_named] + AFTER:
            break
        if case.lost and GONE[0] + STOPPED < driven.time < GONE[1]:
            driven.drive(0.0, 0.0, PERIOD)
            continue
        now = int(utime(np.array([driven.time]))[0])
        left, right = driving.command(now, estimate.place() if case.unseen else driven.place)
        driven.drive(left, right, PERIOD)
        notes.add(driving.note)
        for name in investigation.named:
            named.setdefault(name, driven.time - REST)
        if tell and len(investigation.story) > steps:
            steps = len(investigation.story)
            _tell(driving)
    return _outcome(driven, driving, sizes, named, notes, planner.cpu)


def _outcome(
    driven: DrivenRobot,
    driving: Driving,
    sizes: Mapping[str, float],
    named: Mapping[str, float],
    notes: set[str],
    cpu: float,
) -> Outcome:
    """Return what came of a drive, in which names came first at these times."""
    decision = driving.decision
    own = settled(decision.judgement, decision.known).estimates if decision else {}
    return Outcome(
        named={name: round(time, 2) for name, time in named.items() if name in driving.investigation.named},
        also=tuple(name for name in driving.investigation.found if name not in driving.investigation.named),
        not_shown=tuple(driving.investigation.not_shown(decision.known)) if decision else (),
        ended=round(driven.time - REST, 2),
        within=within(driven.path, driving.investigation.floor),
        sizes=sizes,
        cpu=cpu,
        problem=driving.problem,
        remains=driving.investigation.unexplained.present,
        known={name: (one.value, one.std, float(getattr(driven.parameters, name))) for name, one in own.items()},
        notes=tuple(filter(None, sorted(notes))),
    )


def _recorded(case: InvestigatedCase, driven: DrivenRobot) -> Recording:
    """Return what was recorded so far, without the poses that are not reported."""
    recording = driven.recording()
    if case.unseen:
        return without_poses(recording)
    begin, end = utime(np.array(GONE))
    times = recording.poses.utime
    return replace(recording, poses=recording.poses.where((times < begin) | (times > end))) if case.lost else recording


def _hidden(case: InvestigatedCase) -> tuple[DrivenRobot, Investigation, dict[str, float]]:
    """Return the robot of a case, its investigation, and the sizes of what is hidden."""
    random = np.random.default_rng([case.seed, zlib.crc32("+".join(case.effects).encode())])
    robot = draw_robot(random)
    nominal = dict(draw_nominal(robot, random))
    sizes: dict[str, float] = {}
    for effect in case.effects:
        sizes |= _sized(draw_sizes(effect, robot, CHANGES_WITHIN, random), case.size)
    if "surface_patch" in case.effects:
        away, where = random.uniform(0.2, 0.6), random.uniform(-math.pi, math.pi)
        sizes |= {"surface_patch_x": away * math.cos(where), "surface_patch_y": away * math.sin(where)}
    if case.messy:
        sizes |= imperfections(robot, random)
    floor = Floor(case.fence).with_robots(case.others)
    start = (0.0, 0.0) if case.fence is SQUARE else floor.middle
    driven = DrivenRobot({**robot, **sizes}, seed=int(random.integers(2**31)), pose=(*start, 0.0))
    nominal["wheel_radius"] *= 1.0 + (random.choice((-WRONG, WRONG)) if case.misjudged else 0.0)
    believed = ParameterFile(0, {name: Value(value) for name, value in nominal.items()})
    investigation = Investigation(
        believed,
        floor,
        seed=case.seed,
        limits=UNLIMITED,
        longest=case.longest,
        at_random=case.at_random,
        calibrate=case.calibrate,
    )
    return driven, investigation, sizes


def within(path: Floats, floor: Floor) -> float:
    """Return how far [m] from all that is to be avoided a path (..., 2 or 3) always was; below 0 off the floor."""
    return float(np.min(floor.room(path[..., 0], path[..., 1]))) + floor.margin


def _sized(values: Mapping[str, float], size: float) -> dict[str, float]:
    """Return sizes of an effect times `size`; a limit is so much further away, times, places and angles stay."""
    result = {}
    for name, value in values.items():
        stays = name.endswith(STAYING) and not name.startswith("slope")
        if name in LIMITS:
            result[name] = min(value / size, 1.0 if name == "saturation" else math.inf)
        else:
            result[name] = value if stays else value * size
    return result


def _tell(driving: Driving) -> None:
    step, decision = driving.investigation.story[-1], driving.decision
    best = [(one.name, round(one.evidence, 1)) for one in decision.judgement.explanations[:4]] if decision else []
    own = decision.judgement.best if decision else None
    sizes = {p.name: round(own.values[p.name], 4) for p in CATALOGUE[own.name].parameters} if own and own.name else {}
    print(f"{step.time:6.2f} s {step.named} {best} {sizes} -> {step.movement} {step.parted}", flush=True)
