"""Prepare recordings for the search: put them on the observer's time grid and fit the paper's model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cmr.estimation.candidates import USUAL_INTERVAL, Excitation
from cmr.estimation.checks import SHORTEST, Checked, findings_of, notes_of, refusal
from cmr.estimation.gains import choose_gains
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.initial_guess import LARGEST_DOUBT, guess_base_width, guess_motor, turn_rates
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import Errors, Predictor, errors_of, predictors
from cmr.estimation.problem import Problem
from cmr.estimation.thinning import part_of, thinned, thinning_of
from cmr.geometry.manoeuvres import TYPICAL
from cmr.model.catalogue import CATALOGUE, LAWS, MODELLED
from cmr.model.command_kinds import DUTY
from cmr.model.observer.observer import MOTION, Gains
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.parameters.file import MOTOR, ParameterFile
from cmr.recordings.faults.findings import Finding

THINNED = "More was recorded than the estimate needs; it uses {shares}."
GIVEN = tuple(parameter.name for effect in CATALOGUE.values() for parameter in effect.given)
# Parameters of effects that are never fitted: they are estimated from the residuals, whether given or not.
ACTING_BY_CHANCE = tuple(one.name for effect in CATALOGUE.values() if not effect.is_fitted for one in effect.parameters)
TURNING = 0.05  # rad/s above which a robot turns
FASTEST = 0.98  # share of the time in which a robot turns more slowly than its fastest turns
X, Y = MOTION.index("x"), MOTION.index("y")
NEVER_TURNED = "The robot never turned while its wheels and its pose were recorded."
FEW_TURNS = "The turns of this drive determine the base width to {doubt:.0f} % only."
TURNS = "Record a drive with turns: figure-eights, or circles in both directions."
WITHOUT_WIDTH = "No wheels were recorded (MOTOR_FEEDBACK_N): give base_width, nearly, by --parameters."
WITHOUT_COMMANDS = "No commands were recorded (MOTOR_COMMAND_N), so nothing shows how the motors follow them: "

WORST_FACTOR = 3.0  # ratio of the distances of wheels and poses; beyond it, or below its inverse, one of them is wrong
SHORTEST_WAY = 0.3  # m; root of the sum of squared distances per second
CONTRADICTION = (
    "The wheels turn {factor:.3g} times as far as the poses say: check wheel_radius ({radius:g} m), the encoder's "
    "ticks per turn, and the poses (m, rad, y to the left)."
)


@dataclass(frozen=True)
class Ready:
    """Prepared recordings with the paper's model fitted, or `refused`, a sentence on why not.

    `start` are values of the paper's parameters, by name, that free runs support. `unknown` names parameters in neither
    the recordings nor the nominal parameters: their values are meaningless. `untold` gives, by name, the reason why the
    recordings do not determine one of the paper's parameters.
    """

    problem: Problem | None
    base: Fit | None
    checks: tuple[Finding, ...]
    notes: tuple[str, ...] = ()
    refused: str = ""
    start: Mapping[str, float] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()
    untold: Mapping[str, str] = field(default_factory=dict)

    @property
    def rolling(self) -> bool:
        """Whether no commands were recorded: the robot rolls as its wheels did."""
        return self.base is not None and not set(MOTOR) & set(self.base.names)

    def with_gains(self, gains: Gains) -> tuple[Problem, Fit]:
        """Return the same problem with other observer gains, and the paper's model fitted with them."""
        assert self.problem is not None
        return self._fitted(Problem(self.problem.predictors, gains, self.problem.excitation))

    def part(self, seconds: float) -> "Ready":
        """Return a part of the recordings of this duration [s]."""
        assert self.problem is not None
        segments = part_of([predictor.segment for predictor in self.problem.predictors], seconds)
        problem, base = self._fitted(Problem(predictors(segments), self.problem.gains, self.problem.excitation))
        return replace(self, problem=problem, base=base)

    def _fitted(self, problem: Problem) -> tuple[Problem, Fit]:
        assert self.base is not None
        errors = errors_of(problem.predictors, self.start, problem.gains)
        return problem, _first_fit(problem, self.start, self.base.names, errors)


def _first_fit(problem: Problem, start: Mapping[str, float], names: Sequence[str], errors: Sequence[Errors]) -> Fit:
    """Fit the paper's model from `start` and its `errors`, before the noise is known."""
    return problem.fit(start, tuple(names), Noise.plain(problem.predictors, errors), renew=0)


@dataclass
class _Start:
    """The start of the fit: values by name, of which `names` are free and those of `unknown` meaningless."""

    values: dict[str, float]
    names: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    refused: str = ""
    untold: dict[str, str] = field(default_factory=dict)


def prepare(
    looked: Sequence[Checked], nominal: ParameterFile, *, departing: bool = False, shortest: float = SHORTEST
) -> Ready:
    """Fit the paper's model to the usable recordings, at least `shortest` [s] in all.

    With `departing`, the model includes the effects of the `nominal` robot, not fitted, and the fit begins from it.
    """
    checks, notes, refused = findings_of(looked), notes_of(looked), refusal(looked, shortest)
    if refused:
        return Ready(None, None, checks, notes, refused)
    segments = [segment for one in looked if not one.useless for segment in one.segments]
    thinning = thinning_of(segments)
    parts = [f"one of {one} readings of the {name}" for name, one in thinning.readings._asdict().items() if one > 1]
    if parts:
        notes += (THINNED.format(shares=", ".join(parts)),)
    ready = predictors([thinned(segment, thinning) for segment in segments])
    start = _start(ready, nominal, departing)
    notes += start.notes
    refused = start.refused or _contradiction(ready, start.values["wheel_radius"])
    if refused:
        return Ready(None, None, checks, notes, refused)
    gains = choose_gains(ready, start.values)
    errors = errors_of(ready, start.values, gains)
    given = given_effects(nominal) if departing else {}
    excitation = replace(
        _excitation(ready, start.values, errors),
        poses_late=_poses_late(looked),
        given=given,
        laws=frozenset(nominal.effects) & frozenset(LAWS),
    )
    problem = Problem(ready, gains, excitation)
    base = _first_fit(problem, start.values, start.names, errors)
    problem.excitation = replace(excitation, parameters=base.values)
    return Ready(problem, base, checks, notes, start=start.values, unknown=start.unknown, untold=start.untold)


def _contradiction(ready: Sequence[Predictor], radius: float) -> str:
    """Return a sentence if the distances of wheels and poses contradict each other; otherwise empty.

    Distances are per second: pose noise adds little to them, and heading drift nothing.
    """
    by_wheels, by_poses = 0.0, 0.0
    for one in (predictor.segment.observations for predictor in ready):
        if len(one.pose_time) > 1 and len(one.wheel_time) and not len(one.given):
            seconds = np.arange(one.pose_time[0], one.pose_time[-1])
            turned = np.interp(seconds, one.wheel_time, one.wheel.mean(axis=1))
            place = [np.interp(seconds, one.pose_time, one.pose[:, axis]) for axis in (0, 1)]
            by_wheels += radius**2 * float(np.sum(np.diff(turned) ** 2))
            by_poses += float(np.sum(np.diff(place[0]) ** 2 + np.diff(place[1]) ** 2))
    if max(by_wheels, by_poses) < SHORTEST_WAY**2:
        return ""
    factor = float(np.sqrt(by_wheels / max(by_poses, SHORTEST_WAY**2 / WORST_FACTOR**4)))
    return "" if 1.0 / WORST_FACTOR < factor < WORST_FACTOR else CONTRADICTION.format(factor=factor, radius=radius)


def given_effects(robot: ParameterFile) -> dict[str, float]:
    """Return the parameters, by name, of the effects that a robot has; without those that are never fitted."""
    values = {name: value.value for name, value in robot.values.items() if name not in (*PAPER, *GIVEN)}
    for effect in CATALOGUE.values():
        if effect.is_on(values):
            neutral = {one.name: float(one.neutral) for one in effect.parameters if one.neutral is not None}
            values = {**neutral, **values}
    known = {one.name for effect in MODELLED.values() for one in effect.parameters}
    return {name: value for name, value in values.items() if name in known and name not in ACTING_BY_CHANCE}


def _start(ready: Sequence[Predictor], nominal: ParameterFile, departing: bool) -> _Start:
    """Return the start of the fit and the parameters to fit, which the recordings must determine.

    The conditions of given effects are kept, like the wheel radius, which `nominal` must contain.
    """
    given = (parameter.name for effect in CATALOGUE.values() for parameter in effect.given)
    from_nominal = ("wheel_radius", *given)
    start = _Start({name: nominal.value(name) for name in from_nominal if nominal.has(name)})
    _add_width(start, ready, nominal)
    driven = [predictor for predictor in ready if not len(predictor.segment.observations.given)]
    if start.refused:
        return start
    if departing:
        start.values |= {"base_width": nominal.value("base_width"), **given_effects(nominal)}
    if driven:
        known = departing and nominal.has(*MOTOR)
        start.values |= {n: nominal.value(n) for n in MOTOR} if known else guess_motor(driven, start.values)
        start.names = (*MOTOR, *start.names)
    else:
        _add_nominal_motor(start, nominal)
        if any(len(predictor.segment.observations.pose) for predictor in ready):
            start.names = ("wheel_radius", *start.names)
    if not start.names:
        start.refused = f"Neither commands, turns nor poses determine any parameter of this robot. {TURNS}"
    return start


def _add_width(start: _Start, ready: Sequence[Predictor], nominal: ParameterFile) -> None:
    """Add the base width; if turns do not determine it, use the nominal one, not fitted."""
    width = guess_base_width(ready, start.values["wheel_radius"])
    if not any(len(predictor.segment.observations.wheel_time) for predictor in ready):
        if nominal.has("base_width"):  # the poses determine it, beside how the motors follow commands
            start.values["base_width"] = nominal.value("base_width")
            start.names = ("base_width",)
        else:
            start.refused = WITHOUT_WIDTH
        return
    if width is not None and width.doubt <= LARGEST_DOUBT:
        start.values["base_width"] = width.value
        start.names = ("base_width",)
        return
    why = FEW_TURNS.format(doubt=100.0 * width.doubt) if width else NEVER_TURNED
    start.untold["base_width"] = why
    if nominal.has("base_width"):
        start.values["base_width"] = nominal.value("base_width")
        start.notes = (f"{why} It stays at the nominal {nominal.value('base_width'):.4g} m. {TURNS}",)
    else:
        start.refused = f"{why} {TURNS} Or give base_width by --parameters."


def _add_nominal_motor(start: _Start, nominal: ParameterFile) -> None:
    """Add the given motor parameters, or those of a typical robot as meaningless placeholders."""
    names = " and ".join(MOTOR)
    start.untold |= dict.fromkeys(MOTOR, "No motor commands were recorded.")
    if nominal.has(*MOTOR):
        start.values |= {name: nominal.value(name) for name in MOTOR}
        start.notes += (f"{WITHOUT_COMMANDS}{names} are the nominal ones.",)
    else:
        start.values |= {name: getattr(TYPICAL, name) for name in MOTOR}
        start.unknown = MOTOR
        start.notes += (f"{WITHOUT_COMMANDS}{names} are not among the parameters, and cmr-sim needs them.",)


def _poses_late(looked: Sequence[Checked]) -> float:
    """Return the latency of the poses [s] according to the clock checks, 0 if unknown."""
    lags = [one.findings.lag("poses") for one in looked if not one.useless and not one.note]
    return float(np.median([lag.seconds for lag in lags if lag] or [0.0]))


def _excitation(ready: Sequence[Predictor], values: dict[str, float], errors: Sequence[Errors]) -> Excitation:
    """Return the excitation: how fast the robot turned, how far it went, and how often its pose was reported."""
    motions = [error.motion for error in errors]
    rates = [np.abs(motion[:, MOTION.index("yaw_rate")]) for motion in motions]
    fast = np.concatenate([rate[rate > TURNING] for rate in rates])
    seen = np.concatenate([turn_rates(predictor) for predictor in ready])
    intervals = [np.diff(predictor.segment.observations.pose_time) for predictor in ready]
    squares = np.concatenate([motion[:, X] ** 2 + motion[:, Y] ** 2 for motion in motions])
    return Excitation(
        values,
        turning=float(np.sqrt(np.mean(fast**2))) if len(fast) else 1.0,
        extent=float(np.sqrt(np.mean(squares))),
        fastest=float(np.quantile(seen, FASTEST)) if len(seen) else 0.0,
        controlled=any(predictor.segment.observations.kind != DUTY for predictor in ready),
        interval=float(np.median(np.concatenate(intervals))) if any(map(len, intervals)) else USUAL_INTERVAL,
    )
