"""Bayesian model averaging: parameter estimates that allow for undetected effects.

An effect that was not selected may still be present, and then biases the parameters fitted without it. So each effect
is present with a prior probability, with a prior on its size (`sizes`). The whitened errors are linear in small changes
of the parameters, so for any set of effects the posterior of their sizes is normal and the set's probability is known
in closed form; a random walk samples the sets. It is repeated around the means that it finds, with the noise estimated
there.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.estimation.candidates import DELAYS, can_be_small, rarity
from cmr.estimation.gauss_newton import Fit, moves_of
from cmr.estimation.noise import Noise
from cmr.estimation.problem import Problem
from cmr.estimation.sizes import SPREAD, Sizes
from cmr.model.catalogue import CATALOGUE, definition
from cmr.recordings.signal import Floats, Mask

PRESENT = 0.3  # prior probability that an effect is present
UNCERTAIN, CERTAIN = float(np.log(PRESENT / (1.0 - PRESENT))), 1e3  # log odds
HALF = 0.5  # presence from which an effect with rivals counts as certain
BELIEF = 0.65  # power of the likelihood: the errors are not exactly white, and the model is not exact
# Usual number, and number if the linearisation is poor; each round starts from the previous one's likeliest values.
ROUNDS, MOST_ROUNDS = 3, 6
# Steps of the random walk: for the final estimates, so that sampling noise is below a tenth of a standard deviation; to
# find the likeliest set; and for the means alone.
STEPS, SEARCHING_STEPS, FEW_STEPS = 48_000, 12_000, 5_000
# How much larger the sum of squares may be than the linearisation predicts: absolute, and as a share of the predicted
# drop.
MISJUDGED, SHARE_MISJUDGED = 10.0, 0.1
ALIKE = 0.6  # squared correlation above which an effect can imitate those found
NEAR = 0.5  # standard deviations within which the linearisation holds
# If more than a share of the white errors change by more than this while a slope is computed, its step is reduced.
# Large errors are tempered, so a slope over too large a step would be too small.
CHANGING, MOST, SHORTEST = 1.0, 0.998, 1e-4
# Relative error of slopes. After projection on nearly parallel columns, the residual of a column is no more accurate,
# and must not cause large steps.
INEXACT = 1e-2
LIKELY, SURE = 0.8, 3.0  # probability, or standard deviations from 0, above which an effect counts as present
RIDGE = 1e-9  # share of a column's square; keeps parameters without data where they are


@dataclass(frozen=True)
class Posterior:
    """The posterior of the parameters, allowing for undetected effects.

    `values` are the posterior means by name, including parameters that were not estimated; `names` (p) are those of the
    `covariance` (p, p). `presence` is the probability of each averaged effect at a usual size, `averaging` the problem
    that was sampled. `likeliest` are the values with the likeliest set of effects, `certain` those that were not
    averaged over.
    """

    values: Mapping[str, float]
    names: tuple[str, ...]
    covariance: Floats
    presence: Mapping[str, float]
    averaging: "Averaging"
    likeliest: Mapping[str, float]
    certain: tuple[str, ...] = ()

    def std(self, name: str) -> float:
        """Return the standard deviation of a parameter, in its unit."""
        return float(self.stds[self.names.index(name)])

    @property
    def stds(self) -> Floats:
        """The standard deviations of all parameters (p,); that of a nearly exact parameter may suffer from
        cancellation.
        """
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def likely(self) -> list[str]:
        """The effects that are likely present, however small."""
        return [name for name, presence in self.presence.items() if presence > LIKELY or self._is_sure(name)]

    def _is_sure(self, effect: str) -> bool:
        sizes = [parameter.name for parameter in CATALOGUE[effect].parameters if parameter.switches]
        changes = {name: abs(self.values[name] - self.averaging.neutral(name)) for name in sizes}
        return any(change > SURE * self.std(name) for name, change in changes.items())

    def values_without(self, left_out: Mask) -> Mapping[str, float]:
        """Return the means without some white errors, mask of shape (n,)."""
        return self.averaging.posterior(left_out, FEW_STEPS, self.certain).values


class Averaging:
    """A problem linearised about some values: white errors `rest` (n,), and their slopes by all parameters.

    The paper's parameters, and those of effects without a continuous size, are always present. One walk begins with the
    `likely` effects, by name. `seen` are the values of a fit that indicate the scale of sizes; by default those of
    `fit`. For `ahead`, by parameter, see `Sizes`.
    """

    def __init__(
        self,
        problem: Problem,
        fit: Fit,
        inflation: float,
        likely: Collection[str],
        seen: Mapping[str, float] | None = None,
        ahead: Collection[str] = (),
    ) -> None:
        self._problem, self._inflation = problem, inflation
        self._noise = fit.noise.with_outliers(problem.predictors, problem.errors(fit.values))
        # A rare effect is averaged only if the fit has it: an encoder's scale acts like that of the wheels.
        self._effects = [
            effect
            for effect in problem.effects
            if can_be_small(effect) and (not rarity(effect.name) or effect.is_on(fit.values))
        ]
        self._likely = np.array([effect.name in likely for effect in self._effects], np.bool_)
        self._seen = fit.values if seen is None else seen
        self._sizes = Sizes(self._effects, problem.excitation, ahead)
        sized = {parameter.name for parameter in self._sizes.parameters}
        self._flat = tuple(name for name in fit.names if name not in sized)
        self._names = (*self._flat, *(parameter.name for parameter in self._sizes.parameters))
        self._start = {
            **{parameter.name: problem.excitation.neutral(parameter.name) for parameter in self._sizes.parameters},
            **fit.values,
        }
        self._rest, self._slopes = _linear(problem, self._start, self._names, self._noise)
        self._products, self._pulls = self._slopes.T @ self._slopes, self._slopes.T @ self._rest

    def posterior(self, left_out: Mask | None = None, steps: int = STEPS, certain: Collection[str] = ()) -> Posterior:
        """Return the posterior, from all errors or without those `left_out`, shape (n,), with `certain` effects."""
        products, pulls = self._products, self._pulls
        if left_out is not None:
            slopes = self._slopes[left_out]
            products, pulls = products - slopes.T @ slopes, pulls - slopes.T @ self._rest[left_out]
        belief = min(BELIEF, 1.0 / self._inflation)
        names = [effect.name for effect in self._effects]
        odds = np.array([CERTAIN if n in certain else UNCERTAIN - 0.5 * rarity(n) for n in names])
        return self._averaged(belief * products, belief * pulls, odds, steps, traces=True)

    def likeliest(self, penalties: Mapping[str, float]) -> Mapping[str, float]:
        """Return the values with the likeliest set of effects, each of which must explain as much as its penalty."""
        odds = np.array([-0.5 * penalties[effect.name] / self._inflation for effect in self._effects])
        products, pulls = self._products / self._inflation, self._pulls / self._inflation
        return self._averaged(products, pulls, odds, SEARCHING_STEPS).likeliest

    def is_about(self, found: Posterior) -> bool:
        """Return whether the likeliest values are so near to the linearisation point that another round would not
        help.
        """
        change = np.array([found.likeliest[name] - self._start[name] for name in found.names])
        return bool(np.all(np.abs(change) <= NEAR * found.stds))

    def predicts(self, found: Posterior) -> bool:
        """Return whether the errors at the likeliest values agree with the linearisation."""
        change = np.array([found.likeliest[name] - self._start[name] for name in self._names])
        predicted = self._rest + self._slopes @ change
        better = float(self._rest @ self._rest - predicted @ predicted)
        # Both in one call, and so on one time grid; equal values count as one candidate.
        squares = self._problem.squares([self._start, found.likeliest], self._noise)
        worse = float(squares[-1] - squares[0]) + better
        return worse < max(MISJUDGED, SHARE_MISJUDGED * better)

    def _averaged(
        self, products: Floats, pulls: Floats, odds: Floats, steps: int, *, traces: bool = False
    ) -> Posterior:
        count = len(self._flat)
        ridge = RIDGE * np.diag(self._products)[:count]
        # A parameter without any influence here, such as a limit that is not reached, also keeps its value.
        flat = products[:count, :count] + np.diag(np.where(ridge > 0.0, ridge, 1.0))
        inverse = _inverse(flat)
        mixed = inverse @ np.column_stack([products[:count, count:], pulls[:count]])
        along, own = mixed[:, :-1], mixed[:, -1]
        start = self._of_sizes(self._start)
        normal = products[count:, count:] - products[count:, :count] @ along
        unsure = INEXACT**2 * np.diag(products)[count:]
        seen = self._of_sizes(self._seen)
        pull = pulls[count:] - products[count:, :count] @ own - normal @ start - unsure * seen
        # If less of an effect's trace is its own, the data do not determine it: it may be present with either sign.
        determined = np.diag(normal) > unsure
        normal = (normal + np.diag(unsure)) * np.outer(determined, determined)
        pull = pull * determined
        slabs = self._slabs(normal, seen)
        mean, spread, shares, mode = self._sizes.posterior(
            normal, pull, slabs, odds, self._likely, steps, self._problem.seed, traces=traces
        )
        values, likeliest = (self._with(sizes, -own - along @ (sizes - start)) for sizes in (mean, mode))
        of_flat = inverse + along @ spread @ along.T
        covariance = np.block([[of_flat, -along @ spread], [-spread @ along.T, spread]])
        presence = {effect.name: float(share) for effect, share in zip(self._effects, shares, strict=True)}
        return Posterior(values, self._names, covariance, presence, self, likeliest)

    def _with(self, sizes: Floats, step: Floats) -> dict[str, float]:
        """Return the values with these sizes, and the flat parameters moved by a step."""
        values = dict(self._start)
        sized = zip(self._sizes.parameters, sizes.tolist(), strict=True)
        values.update({one.name: self.neutral(one.name) + change for one, change in sized})
        values.update({n: values[n] + change for n, change in zip(self._flat, step.tolist(), strict=True)})
        return {name: _bounded(name, value) for name, value in values.items()}

    def _of_sizes(self, values: Mapping[str, float]) -> Floats:
        """Return the sizes (p,) of some values: their differences from the given value, or else from neutral."""
        neutral = {one.name: self.neutral(one.name) for one in self._sizes.parameters}
        return np.array([values.get(name, value) - value for name, value in neutral.items()])

    def neutral(self, name: str) -> float:
        """Return the value of a parameter at which its effect is as given, or off."""
        return self._problem.excitation.neutral(name)

    def _slabs(self, normal: Floats, seen: Floats) -> Floats:
        """Return the standard deviations (p,) of the sizes of present effects, given the `seen` sizes (p,).

        They are larger if larger sizes are seen, and for an effect that would need a larger size to explain alone as
        much as the found effects do: otherwise, of two effects that are hard to distinguish, the one found first would
        stay.
        """
        does, squares = normal @ seen, float(seen @ normal @ seen)
        own = np.maximum(np.diag(normal), 1e-300)
        alike = does**2 > ALIKE * own * max(squares, 1e-300)
        usual = SPREAD * self._sizes.usual
        return np.asarray(np.maximum(usual, np.maximum(np.abs(seen), np.where(alike, np.abs(does) / own, 0.0))))


def averaged(
    problem: Problem,
    fit: Fit,
    inflation: float,
    named: Collection[str],
    undisputed: Collection[str] = (),
    steps: int = STEPS,
) -> Posterior:
    """Return the posterior about a fit with effects `named`, from a walk of `steps` steps.

    Named effects that are more likely present than not are kept, and so are those `undisputed`, which no other effect
    explains as well, so that a name and its size agree. The average is over further, undetected effects.
    """
    ahead = [name for name in DELAYS if name in named and fit.values.get(name, 0.0) < 0.0]
    averaging, found = relinearised(problem, fit, inflation, ahead)
    certain = [name for name in named if name in undisputed or found.presence.get(name, 0.0) > HALF]
    return replace(averaging.posterior(steps=steps, certain=certain), certain=tuple(certain))


def averaged_about(problem: Problem, fit: Fit, inflation: float, named: Collection[str]) -> Posterior:
    """Return a rough posterior from slopes at the fit itself, for use if those at better values are invalid."""
    return Averaging(problem, fit, inflation, named).posterior(steps=FEW_STEPS, certain=named)


def relinearised(
    problem: Problem, fit: Fit, inflation: float, ahead: Collection[str] = ()
) -> tuple[Averaging, Posterior]:
    """Return the linear problem about the likeliest values reached from a fit, and a rough posterior."""
    averaging = Averaging(problem, fit, inflation, _on(problem, fit.values), ahead=ahead)
    found = averaging.posterior(steps=FEW_STEPS)
    for number in range(1, MOST_ROUNDS):
        if averaging.predicts(found) and (number >= ROUNDS or averaging.is_about(found)):
            break
        values = found.likeliest
        about = Fit(values, fit.names, fit.rest, fit.slopes, problem.found(problem.errors(values)))
        averaging = Averaging(problem, about, inflation, found.likely, fit.values, ahead)
        found = averaging.posterior(steps=FEW_STEPS)
    return averaging, found


def _inverse(normal: Floats) -> Floats:
    """Return the inverse of a symmetric matrix (p, p) whose rows may have very different units."""
    scale = 1.0 / np.sqrt(np.diag(normal))
    return np.asarray(np.linalg.inv(normal * np.outer(scale, scale)) * np.outer(scale, scale))


def _on(problem: Problem, values: Mapping[str, float]) -> list[str]:
    """Return the effects that some values switch on, or change from the given ones."""
    return [effect.name for effect in problem.effects if problem.excitation.departs(effect, values)]


def _linear(problem: Problem, start: Mapping[str, float], names: Sequence[str], noise: Noise) -> tuple[Floats, Floats]:
    """Return white errors (n,) and their slopes (n, p), over steps that suit the noise."""
    rest, slopes = problem.linear(start, names, noise)
    moves = moves_of(start, names, problem.excitation)
    # Quantiles of rows take half the time of quantiles of columns.
    change = np.quantile(np.abs(slopes.T * moves[:, None]), MOST, axis=1)
    far = np.flatnonzero(change > CHANGING)
    if len(far):
        stride = np.maximum(CHANGING / change[far], SHORTEST)
        slopes[:, far] = problem.linear(start, [names[int(index)] for index in far], noise, stride)[1]
    # Where the model is invalid, the slope is unknown.
    return rest, np.where(np.all(np.isfinite(slopes), axis=0), slopes, 0.0)


def _bounded(name: str, value: float) -> float:
    known = definition(name)
    return float(np.clip(value, known.lower, known.upper))
