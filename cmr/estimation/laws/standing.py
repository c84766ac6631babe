"""Accepted laws in the model: entries of the catalogue from then on, fitted with all other parameters."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from cmr.estimation.gauss_newton import Fit
from cmr.estimation.laws.naming import law_of
from cmr.estimation.laws.offers import Offer
from cmr.estimation.laws.rivals import Hypothesis
from cmr.model.catalogue import LAWS, learn, unlearn
from cmr.model.laws.law import Law


@dataclass(frozen=True)
class Standing:
    """Laws in the model, and the `fit` with them; their coefficients are `names`.

    `new` are those of the laws that were not in the catalogue.
    """

    laws: tuple[Law, ...]
    fit: Fit
    names: tuple[str, ...]
    new: tuple[Law, ...]

    def forget(self) -> None:
        """Remove laws that were only tested from the catalogue."""
        forget(self.new)


def forget(laws: Iterable[Law], known: Collection[str] = ()) -> None:
    """Remove laws that were only tested from the catalogue, except those `known` before, by name."""
    for law in laws:
        if law.name not in known:
            unlearn(law.name)


def stood(beside: Hypothesis, offer: Offer) -> Standing:
    """Add the laws of an offer to the model of a hypothesis, and fit it."""
    before, known = beside.fit, set(LAWS)
    laws = tuple(law_of(candidate) for candidate in offer.laws)
    sizes = {
        name: value
        for law, own in zip(laws, offer.settled.coefficients, strict=True)
        for name, value in zip(law.coefficients, own, strict=True)
    }
    for law in laws:
        learn(law, {name: sizes[name] for name in law.coefficients})
    constants = {law.parameter_of(name): value for law in laws for name, value in law.constants.items()}
    moved = {name: offer.settled.values[name] for name in before.names if name in offer.settled.values}
    noise = offer.settled.noise if beside.problem.one_step else before.noise
    start = {**before.values, **moved, **sizes, **constants}
    fit = beside.problem.fit(start, (*before.names, *sizes), noise, renew=1)
    return Standing(laws, fit, tuple(sizes), tuple(law for law in laws if law.name not in known))
