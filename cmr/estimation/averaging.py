"""Estimates that allow for effects which the data may hide: averages over the presence of each.

An effect that was not named may still be there, and bends the parameters that are fitted without it. So each effect is
present with a prior probability, in a size of which something is known beforehand (`sizes`). The white errors are
linear in small changes of the parameters, so that the posterior of the sizes of any set of effects is normal and its
probability known; a random walk over the sets does the rest. It is repeated about the means that it finds, with the
noise that is left there.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.estimation.candidates import NEVER_AHEAD, can_be_small, lanes_of, rarity
from cmr.estimation.gauss_newton import Fit, moves_of
from cmr.estimation.noise import Noise
from cmr.estimation.problem import Problem
from cmr.estimation.sizes import SPREAD, Sizes
from cmr.model.catalogue import CATALOGUE, definition
from cmr.recordings.signal import Floats, Mask

PRESENT = 0.3  # prior probability that an effect is present
UNCERTAIN, CERTAIN = float(np.log(PRESENT / (1.0 - PRESENT))), 1e3  # logarithms of odds
HALF = 0.5
BELIEF = 0.65  # power of the likelihood: errors are neither quite white nor the model exact
ROUNDS, MOST_ROUNDS = 3, 6  # usually, and where slopes do not hold; each about what the one before found likeliest
# Of the random walk: for what is delivered, where chance is to move it by less than a tenth of its deviation; to find
# the likeliest set; and where the means alone are of interest.
STEPS, SEARCHING_STEPS, FEW_STEPS = 48_000, 12_000, 5_000
# By how much the sum of squares may be larger than slopes say, and which share of what they promise.
MISJUDGED, SHARE_MISJUDGED = 10.0, 0.1
ALIKE = 0.6  # squared correlation from which an effect can stand for those found
NEAR = 0.5  # standard deviations within which slopes hold
# White errors that change by more, all but a share of them, while a slope is taken: it is then taken over less. Large
# errors are made smaller, so that a slope over too much would promise too little.
CHANGING, MOST, SHORTEST = 1.0, 0.998, 1e-4
# Relative error of slopes: what is left of a column beside others that do nearly the same is not known better, and no
# reason to go far from what was seen.
INEXACT = 1e-2
LIKELY, SURE = 0.8, 3.0  # probability, or standard deviations from 0, from which on an effect is taken to be there
RIDGE = 1e-9  # of a column's square over all data: without them a parameter stays where it is


@dataclass(frozen=True)
class Posterior:
    """What is known of the parameters, effects that may be hidden included.

    `values` are the posterior means by name, with what was not estimated; `names` (p) are those of the `covariance`
    (p, p). `presence` is the probability of each effect that could be averaged over, in a size that is usual,
    `averaging` how it was found.
    `likeliest` are the values with the likeliest set of effects, `certain` those that were not averaged over.
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
        """The standard deviations of all parameters (p,); one that is nearly exact may have lost its last digits."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def likely(self) -> list[str]:
        """The effects that are likely there, be they as small as they may."""
        return [name for name, presence in self.presence.items() if presence > LIKELY or self._is_sure(name)]

    def _is_sure(self, effect: str) -> bool:
        sizes = [parameter.name for parameter in CATALOGUE[effect].parameters if parameter.switches]
        changes = {name: abs(self.values[name] - self.averaging.neutral(name)) for name in sizes}
        return any(change > SURE * self.std(name) for name, change in changes.items())

    def values_without(self, left_out: Mask) -> Mapping[str, float]:
        """Return the means that there would be without some white errors, shape (n,)."""
        return self.averaging.posterior(left_out, FEW_STEPS, self.certain).values


class Averaging:
    """A problem made linear about some values: white errors `rest` (n,), and their slopes by all parameters.

    Parameters that are there in any case: the paper's, and those of effects that are no matter of degree. One walk
    begins with the effects that are `likely`, by name. `seen` are the values of a fit that show how large sizes are; by
    default those of `fit`. Of what is `ahead`, by parameter, see `Sizes`.
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
        # A rare effect is averaged over only where the fit has it: an encoder's scale does what the wheels' does.
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
        """Return whether the likeliest values are so near to those it is linear about that another round is idle."""
        change = np.array([found.likeliest[name] - self._start[name] for name in found.names])
        return bool(np.all(np.abs(change) <= NEAR * found.stds))

    def predicts(self, found: Posterior) -> bool:
        """Return whether the errors at the likeliest values are what the slopes say."""
        change = np.array([found.likeliest[name] - self._start[name] for name in self._names])
        predicted = self._rest + self._slopes @ change
        white = self._problem.white(lanes_of([found.likeliest]), self._noise)[:, 0]
        worse = float(white @ white - predicted @ predicted)
        better = float(self._rest @ self._rest - predicted @ predicted)
        return worse < max(MISJUDGED, SHARE_MISJUDGED * better)

    def _averaged(
        self, products: Floats, pulls: Floats, odds: Floats, steps: int, *, traces: bool = False
    ) -> Posterior:
        count = len(self._flat)
        ridge = RIDGE * np.diag(self._products)[:count]
        # What does nothing at all here, such as a limit that is not reached, stays where it is, too.
        flat = products[:count, :count] + np.diag(np.where(ridge > 0.0, ridge, 1.0))
        inverse = _inverse(flat)
        mixed = inverse @ np.column_stack([products[:count, count:], pulls[:count]])
        along, own = mixed[:, :-1], mixed[:, -1]
        start = self._of_sizes(self._start)
        normal = products[count:, count:] - products[count:, :count] @ along
        unsure = INEXACT**2 * np.diag(products)[count:]
        seen = self._of_sizes(self._seen)
        pull = pulls[count:] - products[count:, :count] @ own - normal @ start - unsure * seen
        # Of an effect of which less is its own the data say nothing: it may be there, in either direction.
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
        """Return the sizes (p,) that some values have: by how much they depart from what is given, else neutral."""
        neutral = {one.name: self.neutral(one.name) for one in self._sizes.parameters}
        return np.array([values.get(name, value) - value for name, value in neutral.items()])

    def neutral(self, name: str) -> float:
        """Return the value of a parameter with which its effect is as it is given, or off."""
        return self._problem.excitation.neutral(name)

    def _slabs(self, normal: Floats, seen: Floats) -> Floats:
        """Return the standard deviations (p,) of sizes that are present, where sizes (p,) are seen.

        They are larger where sizes are seen to be larger, and for an effect that would need so much to do alone what
        those do that were found: otherwise, of two effects that are hard to distinguish, the one found would stay.
        """
        does, squares = normal @ seen, float(seen @ normal @ seen)
        own = np.maximum(np.diag(normal), 1e-300)
        alike = does**2 > ALIKE * own * max(squares, 1e-300)
        usual = SPREAD * self._sizes.usual
        return np.asarray(np.maximum(usual, np.maximum(np.abs(seen), np.where(alike, np.abs(does) / own, 0.0))))


def averaged(problem: Problem, fit: Fit, inflation: float, named: Collection[str], steps: int = STEPS) -> Posterior:
    """Return the posterior about a fit with effects `named`, from a walk of so many steps.

    Those of them that are more likely there than not are there: what is averaged over is what may be hidden besides.
    """
    ahead = [name for name in NEVER_AHEAD if name in named and fit.values[name] < 0.0]
    averaging, found = relinearised(problem, fit, inflation, ahead)
    certain = [name for name in named if found.presence.get(name, 0.0) > HALF]
    return replace(averaging.posterior(steps=steps, certain=certain), certain=tuple(certain))


def relinearised(
    problem: Problem, fit: Fit, inflation: float, ahead: Collection[str] = ()
) -> tuple[Averaging, Posterior]:
    """Return the linear problem about the likeliest values that are found from a fit on, and a rough posterior."""
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
    """Return the effects that some values switch on, or make others than they are given."""
    return [effect.name for effect in problem.effects if problem.excitation.departs(effect, values)]


def _linear(problem: Problem, start: Mapping[str, float], names: Sequence[str], noise: Noise) -> tuple[Floats, Floats]:
    """Return white errors (n,) and their slopes (n, p), over distances that suit the noise."""
    rest, slopes = problem.linear(start, names, noise)
    moves = moves_of(start, names, problem.excitation)
    # Of rows the quantiles come in half the time that those of columns take.
    change = np.quantile(np.abs(slopes.T * moves[:, None]), MOST, axis=1)
    far = np.flatnonzero(change > CHANGING)
    if len(far):
        stride = np.maximum(CHANGING / change[far], SHORTEST)
        slopes[:, far] = problem.linear(start, [names[int(index)] for index in far], noise, stride)[1]
    # Where the model does not hold, nothing is known of a slope.
    return rest, np.where(np.all(np.isfinite(slopes), axis=0), slopes, 0.0)


def _bounded(name: str, value: float) -> float:
    known = definition(name)
    return float(np.clip(value, known.lower, known.upper))
