"""Sentences of a diagnosis on the laws that it found."""

import math
from collections.abc import Mapping

from cmr.diagnosis.next_experiment import Driver, manoeuvres_giving
from cmr.estimation.estimates import Estimate
from cmr.estimation.laws.result import APPROXIMATION, LAW, TIE, LawFound, Laws
from cmr.model.laws.sentence import equation, headline

MILLIMETRES = 1000.0
MOST_RIVALS = 3  # that a sentence names
UNNAMED = "No entry of the catalogue describes this."
APPROXIMATED = "It is an approximation of something unknown: structure remains, or the formula is not quite right."
TIED = "What remains, or all of it, is explained as well by a law that this drive cannot distinguish"
SAME_LENGTH = 0.02  # of a path error: smaller changes are called unchanged


def values_of(found: LawFound) -> dict[str, float]:
    """Return the values of a law's coefficients by name."""
    return {name: estimate.value for name, estimate in found.estimates.items()}


def law_sentence(found: LawFound, path_rmse: float = math.nan) -> str:
    """Describe a law, its coefficients, and the reduction of the path error.

    `path_rmse` [m] is the held-out path error of the model with it, NaN if unknown.
    """
    values = values_of(found)
    said = f"{headline(found.law, values)}: {equation(found.law, values)}, {_coefficients(found)}"
    return f"{said}{_gained(found.gain.ratio, path_rmse)}."


def rival_text(rival: LawFound) -> str:
    """Return a rival law as an equation."""
    return equation(rival.law, values_of(rival))


def laws_sentence(laws: Laws, path_rmse: float) -> str:
    """Return sentences on the laws in the model, or on tied ones; empty without any."""
    if not laws.found:
        return f"{TIED}: {_named_rivals(laws)}." if laws.rivals else ""
    *others, last = laws.found
    sentences = [law_sentence(one) for one in others]  # the gain is that of all of them
    sentences.append(law_sentence(last, path_rmse))
    if laws.answer == APPROXIMATION:
        sentences.append(APPROXIMATED)
    elif laws.answer in (LAW, TIE):
        sentences.append(UNNAMED)
    if laws.names_withdrawn:
        sentences.append(f"It replaces {', '.join(laws.names_withdrawn)}, which the search of the catalogue had named.")
    if laws.rivals:
        sentences.append(f"Cannot be distinguished from: {_named_rivals(laws)}.")
    return " ".join(sentences)


def _named_rivals(laws: Laws) -> str:
    """Return the first indistinguishable laws as equations, and the number of others."""
    rivals = [rival_text(one) for one in laws.rivals]
    more = f"; and {len(rivals) - MOST_RIVALS} more" if len(rivals) > MOST_RIVALS else ""
    return f"{'; '.join(rivals[:MOST_RIVALS])}{more}"


def experiment_to_decide(laws: Laws, driver: Driver) -> str:
    """Return what to drive so that a law becomes visible, or one of several is confirmed; empty if nothing is open."""
    if not laws.manoeuvre:
        return ""
    what = "Which formula holds" if laws.rivals or laws.found else "Whether a law holds"
    advice = driver.advice(manoeuvres_giving([laws.manoeuvre]), together=True)
    return f"{what} would show in {laws.manoeuvre}. {advice}"


def _coefficients(found: LawFound) -> str:
    units = found.law.units
    return ", ".join(_with_std(one, units[name]) for name, one in found.estimates.items())


def _with_std(estimate: Estimate, unit: str) -> str:
    """Return a value and its standard deviation, rounded to two digits of the latter."""
    words = "" if unit == "-" else f" {unit}"
    if not (math.isfinite(estimate.std) and estimate.std > 0.0):
        return f"{estimate.value:.3g}{words}"
    decimals = max(0, 1 - math.floor(math.log10(estimate.std)))
    if decimals > 7:
        return f"{estimate.value:.3g} +- {estimate.std:.2g}{words}"
    return f"{estimate.value:.{decimals}f} +- {estimate.std:.{decimals}f}{words}"


def _gained(ratio: float, path_rmse: float) -> str:
    """Return the end of a sentence with the path error before and after."""
    if not (math.isfinite(ratio) and math.isfinite(path_rmse)):
        return ""
    before, after = MILLIMETRES * ratio * path_rmse, MILLIMETRES * path_rmse
    if abs(ratio - 1.0) < SAME_LENGTH:
        return f"; held-out path error {after:.3g} mm, as without it"
    return f"; held-out path error {before:.3g} to {after:.3g} mm"


def constants_of(found: LawFound) -> Mapping[str, float]:
    """Return the values of a law's constants by the names of their parameters."""
    return {found.law.parameter_of(name): value for name, value in found.law.constants.items()}
