"""A linearised model: errors, slopes of its parameters, and traces of laws that may be added.

Errors are kept in the units of their signals and whitened later, so that the noise can be re-estimated with a law in
the model; otherwise the noise would absorb the law.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from cmr.estimation.candidates import lanes_of
from cmr.estimation.gauss_newton import moves_of, one_by_one
from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.variables import Speeds, Variables, commanded, placed, steadied, variables_of
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import FREE, SIGNALS, Batch, Errors, Predictor
from cmr.estimation.problem import Problem
from cmr.estimation.unexplained.traces import DISTURBED, SEEN_IN, Disturbances, only, traces
from cmr.model.laws.grammar import Formula, parse
from cmr.model.laws.places import PLACES
from cmr.model.observer.observer import Observer
from cmr.recordings.signal import Floats

# The quantities that a law disturbs, by its place; for wheels, left and right.
OF_BODY = {
    "forward_speed": "forward",
    "yaw_rate": "yaw_rate",
    "lateral_speed": "sideways",
    "gyro": "gyro",
    "pose_x": "east",
    "pose_y": "north",
    "pose_theta": "heading",
    "pose_ahead": "ahead",
    "pose_beside": "beside",
    "pose_lateness": "lateness",
}
OF_WHEELS = {
    "wheel_acceleration": ("left", "right"),
    "wheel_voltage": ("left", "right"),
    "encoder_rate": ("left_encoder", "right_encoder"),
}
# How the traces of the left and right wheels combine for a law of both.
SIDES: Mapping[str, Floats] = {
    "both": np.array([1.0, 1.0]),
    "opposite": np.array([1.0, -1.0]),
    "left": np.array([1.0, 0.0]),
    "right": np.array([0.0, 1.0]),
}
OF_COMMANDS = frozenset(("u", "other_u", "s", "effort", "other_effort", "load", "charge"))
MAGNITUDES = ("v", "w", "v * w", "s", "u", "effort", "psi")
USUAL = 0.95  # quantile of a quantity's magnitude in the drives that counts as its usual size


def is_of_wheels(place: str) -> bool:
    """Return whether laws at a place have a side."""
    return PLACES[place].per_side


def seen_in(place: str) -> tuple[str, ...]:
    """Return the signals in which a law at a place is visible."""
    if place == "wheel_slip":
        return SEEN_IN["yaw_rate"]
    return SEEN_IN[OF_WHEELS[place][0] if place in OF_WHEELS else OF_BODY[place]]


def shares_of(place: str, values: Mapping[str, float]) -> list[dict[str, float]]:
    """Return the weights with which a law at a place acts on DISTURBED: one set for the body, two for wheels (left,
    right).
    """
    if place == "wheel_slip":
        ahead, turn = 0.5 * values["wheel_radius"], values["wheel_radius"] / values["base_width"]
        return [{"forward": ahead, "yaw_rate": -turn}, {"forward": ahead, "yaw_rate": turn}]
    if place in OF_WHEELS:
        share = values["k2_over_k3"] if place == "wheel_voltage" else 1.0
        return [{name: share} for name in OF_WHEELS[place]]
    return [{OF_BODY[place]: 1.0}]


@dataclass(frozen=True)
class Linearised:
    """A problem at some `values`: `errors` there, and `slopes` by the free parameters `names`, per unit of each.

    Both are given for each segment, in the units of the signals: one column of errors, and one slope per name. Formulas
    use these `speeds`.
    """

    problem: Problem
    values: Mapping[str, float]
    names: tuple[str, ...]
    errors: Sequence[Errors]
    slopes: Sequence[Errors]
    speeds: Speeds = Speeds.OBSERVED

    @classmethod
    def about(cls, problem: Problem, values: Mapping[str, float], names: Sequence[str]) -> "Linearised":
        """Linearise a problem about some values, with `names` free."""
        moves = moves_of(values, names, problem.excitation)
        both = problem.errors(lanes_of([values, *one_by_one(values, names, moves)]))
        errors = [replace(one, of={name: of[:, :1].copy() for name, of in one.of.items()}) for one in both]
        slopes = [
            replace(one, of={name: (of[:, 1:] - of[:, :1]) / moves for name, of in one.of.items()}) for one in both
        ]
        return cls(problem, dict(values), tuple(names), errors, slopes)

    @cached_property
    def noise(self) -> Noise:
        """The noise estimated from the errors."""
        return self.problem.found(self.errors)

    @cached_property
    def variables(self) -> list[Variables]:
        """The variables of formulas in each segment."""
        motions, predictors = [error.motion for error in self.errors], self.problem.predictors
        if self.speeds is not Speeds.OBSERVED and not self.rolls:
            batch = self.problem.batch
            free = [error.motion for error in batch.split(batch.errors(Observer(self.values, FREE)))]
            steady = self.speeds is Speeds.STEADY
            motions = [
                steadied(motion, by_commands, one.segment) if steady else commanded(motion, by_commands)
                for motion, by_commands, one in zip(motions, free, predictors, strict=True)
            ]
        return variables_of(predictors, motions, self.values)

    @cached_property
    def _places(self) -> list[Mapping[str, Floats]]:
        return list(map(placed, self.errors, self.problem.predictors))

    @cached_property
    def rolls(self) -> bool:
        """Whether wheels move as measured, instead of being predicted from commands."""
        return any(len(predictor.segment.observations.given) for predictor in self.problem.predictors)

    def shows(self, law: Candidate) -> bool:
        """Return whether a law is visible: laws of motors, encoders and commands only if commands drive the wheels."""
        if not self.rolls:
            return True
        spoken = {name for text in law.formulas for name in parsed(text, tuple(law.constants)).variables}
        return law.place not in OF_WHEELS and not spoken & OF_COMMANDS

    @cached_property
    def usual(self) -> dict[str, float]:
        """The usual sizes of some variables in these drives."""
        segments = range(len(self.variables))
        sizes = {name: np.concatenate([self.course(k, 0, (name,), {}) for k in segments]) for name in MAGNITUDES}
        return {name: max(float(np.quantile(np.abs(one), USUAL)), 1e-6) for name, one in sizes.items()}

    @cached_property
    def _known(self) -> dict[tuple[str, int, int, tuple[tuple[str, float], ...]], Floats]:
        return {}

    @contextmanager
    def only_tried(self) -> Iterator[None]:
        """On exit, drop the factor values cached meanwhile: there are many for constants that are only tested."""
        before = set(self._known)
        yield
        for key in set(self._known) - before:
            del self._known[key]

    def sized(self, candidate: Candidate) -> Candidate:
        """Return a candidate with constants in units: shares of usual sizes are converted."""
        if not candidate.scaled:
            return candidate
        usual = self.usual[candidate.scaled]
        constants = {name: share * usual for name, share in candidate.constants.items()}
        return replace(candidate, constants=constants, scaled="")

    @cached_property
    def _batches(self) -> dict[tuple[str, ...], Batch]:
        return {}

    def _only(self, signals: Sequence[str]) -> Batch:
        """Return the segments restricted to some signals; the same objects each time, because they cache results."""
        key = tuple(signals)
        if key not in self._batches:
            self._batches[key] = Batch([only(predictor, signals) for predictor in self.problem.predictors])
        return self._batches[key]

    def raw(self, laws: Sequence[Candidate], signals: Sequence[str] = SIGNALS) -> list[Errors]:
        """Return the traces of laws of one place in each segment: a column per formula, two for wheels.

        For wheels, left and right columns stand side by side.
        """
        views = self._only(signals).predictors
        return [
            self._traces(number, view, error.motion, laws)
            for number, (view, error) in enumerate(zip(views, self.errors, strict=True))
        ]

    def _traces(self, number: int, view: Predictor, motion: Floats, laws: Sequence[Candidate]) -> Errors:
        courses, shares = [], []
        for law in laws:
            acts = shares_of(law.place, self.values)
            for factors in law.all_factors:
                for side, act in enumerate(acts):
                    courses.append(self.course(number, side if len(acts) > 1 else -1, factors, law.constants))
                    shares.append([act.get(name, 0.0) for name in DISTURBED])
        disturbances = Disturbances(np.stack(courses, axis=1), np.array(shares).T.copy())
        return traces(view, motion, self.values, self.problem.gains, disturbances)

    def white_traces_of(self, place: str, courses: Sequence[Sequence[Floats]], noise: Noise) -> Floats:
        """Return white traces, over all errors, of disturbances at a place with these time courses in each segment.

        For wheels, left and right columns stand side by side.
        """
        acts = shares_of(place, self.values)
        parts = []
        for predictor, error, own in zip(self.problem.predictors, self.errors, courses, strict=True):
            shares = np.array([[acts[n % len(acts)].get(name, 0.0) for name in DISTURBED] for n in range(len(own))])
            disturbances = Disturbances(np.stack(own, axis=1), shares.T.copy())
            parts.append(traces(predictor, error.motion, self.values, self.problem.gains, disturbances))
        return self.problem.made_white(parts, noise)

    def course(self, number: int, side: int, factors: Sequence[str], constants: Mapping[str, float]) -> Floats:
        """Return a product of factors along segment `number`, (T,); for wheels on side 0 or 1, else -1."""
        result = self._factor(number, side, factors[0], constants)
        for text in factors[1:]:
            result = result * self._factor(number, side, text, constants)
        return result

    def _factor(self, number: int, side: int, text: str, constants: Mapping[str, float]) -> Floats:
        named = tuple((name, value) for name, value in constants.items() if name in text)
        key = (text, number, side, named)
        if key not in self._known:
            of = self.variables[number]
            given = of.body if side < 0 else of.wheels[side]
            given = {**given, **self._places[number]} if "disc(" in text else given
            value = parsed(text, tuple(name for name, _ in named)).evaluate({**given, **dict(named)})
            self._known[key] = np.broadcast_to(value, given["v"].shape)
        return self._known[key]

    def white_traces(self, laws: Sequence[Candidate], noise: Noise, signals: Sequence[str]) -> Floats:
        """Return whitened traces of laws of one place, in the rows of those signals alone."""
        batch = self._only(signals)
        return noise.all_white(batch, batch.joined(self.raw(laws, signals)))


@lru_cache(maxsize=4096)
def parsed(text: str, constants: tuple[str, ...]) -> Formula:
    """Return a formula; the same texts recur with other values of their constants."""
    return parse(text, constants)


def mixed(candidate: Candidate, columns: Floats) -> Floats:
    """Return the traces (n, k) of a law from its `columns`; for wheels, both sides are combined for the law's side."""
    if not is_of_wheels(candidate.place):
        return columns
    return np.asarray(columns.reshape(len(columns), -1, 2) @ SIDES[candidate.side])
