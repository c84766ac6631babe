"""An investigation, decision by decision: judge the data so far, name effects, and choose the next movement."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from cmr.estimation.unexplained.result import Unexplained
from cmr.investigation.beyond import unexplained_by
from cmr.investigation.calibrating import LEAST, averaged, is_calibrated, settled
from cmr.investigation.choosing import Choice, Evidence, choose, evidence_of, keeps_to, only
from cmr.investigation.evidence import Beliefs, beliefs_of
from cmr.investigation.floor import Floor
from cmr.investigation.foreseeing import Growth
from cmr.investigation.judging import NAMED, ODDS, Judgement
from cmr.investigation.movements import Movement, opening, waiting
from cmr.investigation.naming import Naming
from cmr.investigation.prediction import Situation, effort, paths
from cmr.investigation.reckoning import Reckoned, reckoned
from cmr.investigation.separation import BELIEF
from cmr.model.catalogue import CATALOGUE
from cmr.model.commands import Commands
from cmr.model.duty_ramp import Limits
from cmr.model.observer.observer import MOTION
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Times

NEAR = 0.4  # share of the evidence for a name, from which an explanation is suspected
LONGEST = 60.0  # s of driving
LONG_ENOUGH = 20.0  # s of driving after which effects that will not show are given up
HOPE = BELIEF * 6.0**2  # squared distance that is worth waiting for: six deviations
OPENING = "opening"  # the name of the first movement
UNDER_WAY = 0.6  # s: older commands have arrived
OWN = ("wheel_radius", "k2_over_k3", "k1", "base_width")
STATE = ("x", "y", "theta", "psi_left", "psi_right")
OPENING_DOUBTS = ({"k1": 0.85, "k2_over_k3": 1.3}, {"k1": 1.15}, {"k1": 0.85, "base_width": 0.85})
DATA_SHEET = "The opening does not keep to the floor from here, by the data sheet: put the robot nearer to the middle."
NO_ROOM = "No movement keeps to the floor from here."
UNSURE = "Without poses, the robot's place is too unsure for any movement: it may be near the border."


@dataclass(frozen=True)
class Step:
    """One decision of the story: when [s since the drive began], the likeliest explanation, its odds, and the choice.

    `held_back` says why the likeliest effect is not named, whatever its odds.
    """

    time: float
    named: tuple[str, ...]
    odds: Mapping[str, float]
    movement: str
    seconds: float
    parted: tuple[str, str]
    held_back: str = ""


@dataclass
class Decision:
    """The result of a decision: effects `named`, the next movement, None at the end, and its reason.

    `held_back` says why the likeliest effect is not among them, whatever its odds. `reckoned` is the robot's place by
    dead reckoning at that time, None if poses are reported.
    """

    judgement: Judgement
    known: Evidence
    named: tuple[str, ...]
    choice: Choice
    finished: bool
    sentence: str = ""
    reckoned: Reckoned | None = None
    held_back: str = ""


@dataclass
class Planned:
    """The commands still to be driven: at `utime` [us], (n,), of `duty` (n, 2), until `ends` [us]."""

    utime: Times
    duty: Floats
    ends: int

    @classmethod
    def of(cls, movement: Movement, begins: int) -> "Planned":
        """Return a movement that begins at this time [us]."""
        utime = begins + np.rint(movement.time / SECONDS).astype(np.int64)
        return cls(utime, movement.duty, begins + round(movement.seconds / SECONDS))


class Investigation:
    """Finds out what a robot's model gets wrong, on a `floor`; `nominal` are the parameters assumed at first.

    `found` are the effects found so far; those `named` are still valid and large enough to matter. `story` lists the
    decisions. `unexplained` is the structure that remained beside these names at the last check. It ends `longest` [s]
    after it began, not counting the time `waited` [s] for late decisions. With `at_random` movements are drawn, not
    chosen. With `calibrate` it ends as soon as the robot's own parameters are known.
    """

    def __init__(
        self,
        nominal: ParameterFile,
        floor: Floor,
        *,
        seed: int = 0,
        limits: Limits | None = None,
        longest: float = LONGEST,
        at_random: bool = False,
        calibrate: bool = False,
    ) -> None:
        self.nominal, self.floor = nominal, floor
        self.story: list[Step] = []
        self.unexplained = Unexplained()
        self._random = np.random.default_rng(seed)
        self._limits = limits or Limits()
        self.longest, self.waited = longest, 0.0
        self._at_random, self._calibrate = at_random, calibrate
        self._naming, self._growth = Naming(), Growth()
        self._sought: tuple[str, ...] = ()  # effects that a calibration drives for
        self._start: tuple[float, float, float] | None = None  # initial pose of the robot: x, y [m], theta [rad]

    def opening(self, x: float, y: float, theta: float) -> tuple[Movement, str]:
        """Return the first movement of a robot at rest at this pose, and a sentence that says why it must not drive."""
        self._start = self._start or (x, y, theta)
        whole = Movement(OPENING, np.concatenate([one.duty for one in opening()]))
        with_waiting = Movement(OPENING, np.concatenate([whole.duty, waiting().duty]))
        nominal = {name: self.nominal.value(name) for name in OWN}
        robots = [nominal, *({**nominal, **{n: f * nominal[n] for n, f in doubt.items()}} for doubt in OPENING_DOUBTS)]
        none = Commands(np.array([-1.0]), np.zeros((1, 2)))
        still = Situation((x, y, theta, 0.0, 0.0), 0.0, (0.0, 0.0), none, 0.0, 0.0, 0.0, self._limits, (None,) * 3)
        return whole, "" if keeps_to(self.floor, paths(still, [with_waiting], robots)[0]) else DATA_SHEET

    def decide(self, recording: Recording, planned: Planned, least: float = 0.0) -> Decision | None:
        """Choose from the recording so far what to drive after `planned`; return None while the recording is too short.

        Only movements of `least` [s] or longer are candidates: the next decision takes so long.
        """
        with threadpool_limits(1, "blas"):
            problem = beliefs_of(recording, self.nominal, self.floor.extent, self._put_down)
            if problem is None:
                return None
            here = None if len(recording.poses) else self._reckoned(recording)
            judgement = self._naming.judged(problem)
            known = self._without_hope(evidence_of(judgement, problem.last), judgement)
            known = replace(known, unconfirmed=self._naming.unconfirmed)
            over = self._is_over(judgement, known, problem.last)
            if over or self.named:
                self.unexplained = unexplained_by(judgement)
            choice = Choice(None)
            if not over:
                situation = _situation(judgement, recording, planned, self._limits)
                if here is not None:
                    situation = replace(situation, state=(*here.place, *situation.state[3:]))
                to_show = only(known, self._sought) if self._sought else known
                choice = choose(judgement, to_show, situation, self.floor, self._random, self._at_random, least, here)
                if not self._sought:
                    self._growth.rates = choice.best_rates
            self._note(judgement, choice)
            sentence = "" if over or choice.movement else NO_ROOM if here is None else UNSURE
            return Decision(judgement, known, self.named, choice, over, sentence, here, self._naming.held_back)

    def _reckoned(self, recording: Recording) -> Reckoned:
        """Return the place of the robot by dead reckoning."""
        radius, width = self.nominal.value("wheel_radius"), self.nominal.value("base_width")
        return reckoned(recording, self._put_down, radius, width)

    @property
    def _put_down(self) -> tuple[float, float, float]:
        return self._start or (0.0, 0.0, 0.0)

    @property
    def found(self) -> tuple[str, ...]:
        """The effects found so far."""
        return self._naming.found

    @property
    def named(self) -> tuple[str, ...]:
        """The effects found that still reach the odds of a name and are large enough to matter."""
        return self._naming.named

    @property
    def doubted(self) -> tuple[str, ...]:
        """The effects found that no longer reach the odds of a name."""
        return self._naming.doubted

    def _is_over(self, judgement: Judgement, known: Evidence, time: float) -> bool:
        """Return whether the investigation is complete: all other effects would have shown, or its time is over.

        For a calibration, note which effects are sought.
        """
        self._sought = ()
        if time - self.waited > self.longest:
            return True
        if self.doubted or self._suspected(judgement):
            return False
        if self._calibrate:
            return time > LEAST and self._is_calibrated(judgement, known)
        return {*self.not_shown(known)} <= known.hopeless

    def _is_calibrated(self, judgement: Judgement, known: Evidence) -> bool:
        """Return whether the robot's own parameters are certain enough; if not, note which effects are sought."""
        if not is_calibrated(averaged(judgement, known)):
            return False
        own = settled(judgement, known)
        may_show = [name for name in known.columns.of if name not in known.shown and name not in known.hopeless]
        self._sought = tuple(name for name in own.sought if name in may_show)
        return own.is_calibrated

    def _without_hope(self, known: Evidence, judgement: Judgement) -> Evidence:
        """Return the information with all effects that cannot show here, however the rest of the drive is spent."""
        time = judgement.problem.last
        self._growth.note(time - self.waited, known.seen, judgement.named)
        if time - self.waited < LONG_ENOUGH:
            return known
        late = [name for name in self.not_shown(known) if self._growth.foreseen(name, self.longest) < HOPE]
        return replace(known, hopeless=known.hopeless | {*late})

    def _suspected(self, judgement: Judgement) -> bool:
        """Return whether an explanation is close to being named, and large enough to matter."""
        near = [one for one in judgement.left if one.name and one.evidence > NEAR * NAMED]
        return any(judgement.is_large(one.name, one.values) for one in near)

    def not_shown(self, known: Evidence) -> list[str]:
        """Return the effects that would not have shown yet; one that begins at a time may always come."""
        names = known.columns.names
        return [name for name in names if name not in known.shown and CATALOGUE[name].locality != "time"]

    def _note(self, judgement: Judgement, choice: Choice) -> None:
        likely = {name: share for name, share in judgement.probabilities.items() if share > 1.0 / ODDS}
        movement = choice.movement
        text, seconds = (movement.name, movement.seconds) if movement else ("", 0.0)
        held_back = self._naming.held_back
        self.story.append(Step(judgement.problem.last, self.named, likely, text, seconds, choice.parted, held_back))


def _situation(judgement: Judgement, recording: Recording, planned: Planned, limits: Limits) -> Situation:
    """Return the robot's state by the best explanation, and its pending commands."""
    problem, values = judgement.problem, judgement.best.values
    segment = problem.predictors[-1].segment
    observations = segment.observations
    motion = problem.joint_errors(values).motion
    here = motion[-1]
    now = segment.first + round(observations.seconds / SECONDS)
    turned = np.array(observations.turned) + (observations.wheel[-1] if len(observations.wheel) else 0.0)
    sent = recording.duty.between(now - round(UNDER_WAY / SECONDS), now)
    to_come = planned.utime >= now
    time = np.concatenate([(sent.utime - now) * SECONDS - 1e-6, (planned.utime[to_come] - now) * SECONDS])
    duty = np.concatenate([np.stack([sent["left"], sent["right"]], axis=1), planned.duty[to_come]])
    energy, heat = _effort(problem, motion, values)
    x, y, theta, left, right = (float(here[MOTION.index(name)]) for name in STATE)
    return Situation(
        state=(x, y, theta, left, right),
        time=problem.last,
        turned=(float(turned[0]), float(turned[1])),
        commands=Commands(time, duty),
        busy=max(0.0, (planned.ends - now) * SECONDS),
        energy=energy,
        heat=heat,
        limits=limits,
        intervals=(
            _interval(recording.wheels.utime),
            _interval(recording.gyro.utime),
            _interval(recording.poses.utime),
        ),
    )


def _interval(utime: Times) -> float | None:
    """Return the usual time [s] between readings; None without any."""
    return float(np.median(np.diff(utime))) * SECONDS if len(utime) > 1 else None


def _effort(problem: Beliefs, motion: Floats, values: Mapping[str, float]) -> tuple[float, float]:
    """Return the energy drawn from the battery [s of load share 1] and the motors' heat, by the model."""
    result = 0.0, 0.0
    borders = problem.batch.borders
    for number, predictor in enumerate(problem.predictors):
        observations = predictor.segment.observations
        psi = motion[borders[number] : borders[number + 1] - 1]
        psi = psi[:, [MOTION.index("psi_left"), MOTION.index("psi_right")]]
        result = effort(observations.duty, psi, observations.dt, values["k1"], result)
    return result
