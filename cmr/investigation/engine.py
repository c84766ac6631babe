"""An investigation, decision by decision: what the data so far say, which effects are named, and what to drive next."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from cmr.estimation.candidates import locality
from cmr.estimation.gains import COARSE
from cmr.estimation.search.chance import tick_of
from cmr.investigation.calibrating import LEAST, averaged, is_calibrated
from cmr.investigation.choosing import SAME, SEEN, Choice, Told, choose, keeps_to, told
from cmr.investigation.evidence import Beliefs, beliefs_of
from cmr.investigation.exchanging import evidence_beside, revision
from cmr.investigation.floor import Floor
from cmr.investigation.judging import NOTHING, Explanation, Judgement, ahead_since, judge, own_parameters
from cmr.investigation.movements import Movement, opening, waiting
from cmr.investigation.prediction import Situation, paths
from cmr.model.catalogue import CATALOGUE
from cmr.model.commands import Commands
from cmr.model.duty_ramp import Limits
from cmr.model.effects.motors import HEATING_TIME
from cmr.model.observer.observer import MOTION
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Times

ODDS = 1000.0  # at which an effect is named
NAMED = 2.0 * math.log(ODDS)
# Evidence that the data after the first suspicion must have of their own, as a share of the margin then, within bounds.
CONFIRMED_SHARE, CONFIRMED = 0.1, (4.0, NAMED)
LOCAL = 8.0  # drop by which effects at a place or a time must lose by the data, not by their number of parameters
NEAR = 0.4  # of the margin: a name that is nearer is not ruled out
LONGEST = 60.0  # s of driving
OPENING = "opening"  # the name of the first movement
UNDER_WAY = 0.6  # s: older commands have arrived
COARSE_TICKS = "encoder_quantisation"
STATE = ("x", "y", "theta", "psi_left", "psi_right")
OPENING_DOUBTS = ({"k1": 0.85, "k2_over_k3": 1.3}, {"k1": 1.15}, {"k1": 0.85, "base_width": 0.85})
DATA_SHEET = "The opening does not keep to the floor from here, by the data sheet: put the robot nearer to the middle."
NO_ROOM = "No movement keeps to the floor from here."


@dataclass(frozen=True)
class Step:
    """One decision of the story: when [s since the drive began], what was likeliest, how sure, and what was chosen."""

    time: float
    named: tuple[str, ...]
    odds: Mapping[str, float]
    movement: str
    seconds: float
    parted: tuple[str, str]


@dataclass
class Decision:
    """What came of looking at the data: effects `named`, the movement to drive next, None when it is over, and why."""

    judgement: Judgement
    known: Told
    named: tuple[str, ...]
    choice: Choice
    finished: bool
    sentence: str = ""


@dataclass
class _Suspect:
    """An effect that reached the odds first with this margin, by the data until `time` [s]."""

    name: str
    margin: float
    time: float


@dataclass
class Planned:
    """What is still to be driven: commands at `utime` [us], (n,), of `duty` (n, 2), until `ends` [us]."""

    utime: Times
    duty: Floats
    ends: int

    @classmethod
    def of(cls, movement: Movement, begins: int) -> "Planned":
        """Return a movement that begins at this time [us]."""
        utime = begins + np.rint(movement.time / SECONDS).astype(np.int64)
        return cls(utime, movement.duty, begins + round(movement.seconds / SECONDS))


class Investigation:
    """Finds out what a robot's model gets wrong, on a `floor`; `nominal` is what is believed of the robot.

    `found` are the effects found so far, of which those `named` still stand and are large enough to matter; `story` are
    the decisions. It ends `longest` [s] after it began, not counting what the robot `waited` [s] for late decisions.
    With `at_random` movements are drawn, not chosen; to `calibrate` is to end as soon as the robot's own parameters are
    known.
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
        self.found: tuple[str, ...] = ()
        self.story: list[Step] = []
        self._random = np.random.default_rng(seed)
        self._limits = limits or Limits()
        self.longest, self.waited = longest, 0.0
        self._at_random, self._calibrate = at_random, calibrate
        self._judgement: Judgement | None = None
        self._suspect: _Suspect | None = None
        self._doubted: frozenset[str] = frozenset()
        self._wanted: frozenset[str] | None = None  # the set of effects that was better at the last decision

    def opening(self, x: float, y: float, theta: float) -> tuple[Movement, str]:
        """Return the first movement of a robot at rest at this pose, and a sentence that says why it must not drive."""
        whole = Movement(OPENING, np.concatenate([one.duty for one in opening()]))
        with_waiting = Movement(OPENING, np.concatenate([whole.duty, waiting().duty]))
        known = {name: value.value for name, value in self.nominal.values.items()}
        nominal = {name: known[name] for name in ("wheel_radius", "k2_over_k3", "k1", "base_width")}
        robots = [nominal, *({**nominal, **{n: f * nominal[n] for n, f in doubt.items()}} for doubt in OPENING_DOUBTS)]
        none = Commands(np.array([-1.0]), np.zeros((1, 2)))
        still = Situation((x, y, theta, 0.0, 0.0), 0.0, (0.0, 0.0), none, 0.0, 0.0, 0.0, self._limits, (None,) * 3)
        return whole, "" if keeps_to(self.floor, paths(still, [with_waiting], robots)[0]) else DATA_SHEET

    def decide(self, recording: Recording, planned: Planned, least: float = 0.0) -> Decision | None:
        """Look at the recording so far and choose what to drive after what is `planned`; None while it is too short.

        Of movements, those that take `least` [s] or longer are chosen from: in so long the next decision is made.
        """
        with threadpool_limits(1, "blas"):
            problem = beliefs_of(recording, self.nominal, self.floor.extent)
            if problem is None:
                return None
            judgement = self._judged(problem)
            known = told(judgement, _seconds(problem))
            over = self._is_over(judgement, known, _seconds(problem))
            choice = Choice(None)
            if not over:
                situation = _situation(judgement, recording, planned, self._limits)
                choice = choose(judgement, known, situation, self.floor, self._random, self._at_random, least)
            self._note(judgement, choice)
            sentence = "" if over or choice.movement else NO_ROOM
            return Decision(judgement, known, self.named, choice, over, sentence)

    @property
    def named(self) -> tuple[str, ...]:
        """The effects found that stand at the odds of a name, and are large enough to matter."""
        return tuple(name for name in self.found if name not in self._doubted and self._matters(name))

    @property
    def doubted(self) -> tuple[str, ...]:
        """The effects found that do not stand at the odds of a name any more."""
        return tuple(name for name in self.found if name in self._doubted)

    def _matters(self, name: str) -> bool:
        if name == COARSE_TICKS or self._judgement is None:
            return True
        return self._judgement.is_large(name, self._judgement.base.values)

    def _judged(self, problem: Beliefs) -> Judgement:
        """Return the judgement of all data, after adding to what is found what is sure enough."""
        before = self._judgement
        start = dict(before.base.values) if before else {name: v.value for name, v in self.nominal.values.items()}
        usable = {"wheel_radius", "k2_over_k3", "k1", "base_width", *own_parameters(_fitted(self.found))}
        start = {name: value for name, value in start.items() if name in usable}
        judgement = judge(problem, _fitted(self.found), start, before)
        if tick_of(problem) > COARSE and COARSE_TICKS not in self.found:
            self.found = (*self.found, COARSE_TICKS)
        while (name := self._confirmed(judgement)) != NOTHING:
            self.found = (*self.found, name)
            self._suspect = None
            judgement = judge(problem, _fitted(self.found), judgement.best.values)
        self._judgement = self._revised(judgement)
        return self._judgement

    def _revised(self, judgement: Judgement) -> Judgement:
        """Return the judgement beside another set of effects, if that was clearly better twice in a row.

        What another set lacks that explains the data better, and what the data may do without, is doubted.
        """
        self._doubted = frozenset()
        if not judgement.named:
            self._wanted = None
            return judgement
        beside = evidence_beside(judgement)
        self._doubted = frozenset(name for name, evidence in beside.items() if evidence < NAMED)
        found = revision(judgement, beside)
        before, self._wanted = self._wanted, frozenset(found.names) if found else None
        if found is None:
            return judgement
        gone = {name for name in judgement.named if name not in found.names}
        self._doubted |= gone
        coming = [name for name in found.names if name not in judgement.named]
        if self._wanted != before or (coming and found.lead < NAMED):
            return judgement
        self.found = (*(name for name in self.found if name not in gone), *coming)
        self._wanted, self._suspect = None, None
        return judge(judgement.problem, _fitted(self.found), found.values)

    def _confirmed(self, judgement: Judgement) -> str:
        """Return the effect that is sure now; NOTHING where none is."""
        best, sure = judgement.best, margin(judgement)
        if best.name == NOTHING or sure < NAMED:
            self._suspect = None
            return NOTHING
        if self._suspect is None or self._suspect.name != best.name:
            self._suspect = _Suspect(best.name, sure, _seconds(judgement.problem))
            return NOTHING
        # One lost packet looks like backlash until the robot has driven on.
        nothing, rival = judgement.of(NOTHING), _rivals(judgement)[0]
        assert nothing is not None
        least, most = CONFIRMED
        needed = min(max(CONFIRMED_SHARE * self._suspect.margin, least), most)
        allowed = max(CONFIRMED_SHARE * sure, least)  # a rival far behind may fit the newest data a little better
        since = self._suspect.time
        is_confirmed = (
            ahead_since(judgement, nothing, since) >= needed and ahead_since(judgement, rival, since) >= -allowed
        )
        return best.name if is_confirmed else NOTHING

    def _is_over(self, judgement: Judgement, known: Told, time: float) -> bool:
        """Tell whether nothing is left to be found out here: all else would have shown, or it took long enough."""
        if time - self.waited > self.longest:
            return True
        if self._calibrate:
            return time > LEAST and is_calibrated(averaged(judgement, known))
        return not self._doubted and not self._suspected(judgement) and not self.not_shown(known)

    def _suspected(self, judgement: Judgement) -> bool:
        """Tell whether an explanation is near its name, and large enough to matter."""
        near = [one for one in judgement.left if one.name and one.evidence > NEAR * NAMED]
        return any(judgement.is_large(one.name, one.values) for one in near)

    def not_shown(self, known: Told) -> list[str]:
        """Return the effects that would not have shown yet; one that begins at a time may always come."""
        return [name for name, seen in known.seen.items() if seen < SEEN and locality(CATALOGUE[name]) != "time"]

    def _note(self, judgement: Judgement, choice: Choice) -> None:
        likely = {name: share for name, share in judgement.probabilities.items() if share > 1.0 / ODDS}
        movement = choice.movement
        text, seconds = (movement.name, movement.seconds) if movement else ("", 0.0)
        self.story.append(Step(_seconds(judgement.problem), self.named, likely, text, seconds, choice.parted))


def margin(judgement: Judgement) -> float:
    """Return by how much evidence the likeliest explanation is ahead of all that are not the same mathematics.

    It is 0 at most while one of a place or a time, which has many parameters, explains the data nearly as well.
    """
    best, rivals = judgement.best, _rivals(judgement)
    ahead = min((best.evidence - one.evidence for one in rivals), default=0.0)
    close = any(_is_local(one) and one.fitted and best.drop - one.drop < LOCAL for one in rivals)
    return min(ahead, 0.0) if close else ahead


def _rivals(judgement: Judgement) -> list[Explanation]:
    """Return the explanations beside the likeliest that are not the same mathematics, the nearest first."""
    return [one for one in judgement.explanations[1:] if frozenset((judgement.best.name, one.name)) not in SAME]


def _is_local(one: Explanation) -> bool:
    return bool(one.name and locality(CATALOGUE[one.name]))


def _fitted(named: Sequence[str]) -> tuple[str, ...]:
    """Return the named effects that fits have."""
    return tuple(name for name in named if name != COARSE_TICKS)


def _seconds(problem: Beliefs) -> float:
    """Return how long the drive took so far [s]."""
    last = problem.predictors[-1].segment.observations
    return last.time + last.seconds


def _situation(judgement: Judgement, recording: Recording, planned: Planned, limits: Limits) -> Situation:
    """Return where the robot is by the best explanation, and what it is about to do."""
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
        time=_seconds(problem),
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
    """Return what the battery has given [s of load share 1] and how warm the motors are, as the model has them."""
    energy, heat = 0.0, 0.0
    borders = problem.batch.borders
    for number, predictor in enumerate(problem.predictors):
        observations = predictor.segment.observations
        duty, psi = observations.duty, motion[borders[number] : borders[number + 1] - 1]
        psi = psi[:, [MOTION.index("psi_left"), MOTION.index("psi_right")]]
        energy += float(np.sum(np.maximum(0.0, duty * (duty - 0.8 * values["k1"] * psi)))) * observations.dt
        kept = np.exp(-observations.dt / HEATING_TIME)
        squares = np.mean(duty**2, axis=1)
        weights = kept ** np.arange(len(squares))[::-1]
        heat = heat * kept ** len(squares) + float(np.sum((1.0 - kept) * weights * squares))
    return energy, heat
