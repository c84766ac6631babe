"""Extend the model for structure that remains after a search.

The extension is a law, if one holds, otherwise a generic term.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cmr.estimation.gain import measure
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.laws.proposing import Proposal, proposed
from cmr.estimation.laws.result import Laws
from cmr.estimation.problem import Problem
from cmr.estimation.search.selection import Search, with_small_effects
from cmr.estimation.search.trace import with_removed
from cmr.estimation.segments import Segment
from cmr.estimation.unexplained.by_formula import structure_of
from cmr.estimation.unexplained.generic import LEAST_GAIN, Extension, extension
from cmr.estimation.unexplained.remaining import remaining
from cmr.estimation.unexplained.result import Unexplained

SURPASSED = 0.8  # of some free-run error with the named effects, that a term without them must reach
# Of models fitted by free runs, whose odometry has errors of its own on every real robot (OptiOdom: 0.18 and 1.10).
MUCH_UNEXPLAINED, MUCH_GAINED = 0.25, 1.25  # share of a signal's one-step errors; gain in the path error of free runs
WITHDRAWN = "A generic term predicts much better than it does, and as well without it."
BY_A_LAW = "A law explains more than it does, and as well without it."
OF_NO_USE = "With it, free runs on data left out of the fit are less accurate than with the paper's model."


@dataclass(frozen=True)
class Extended:
    """The search result, what remains unexplained, and the accepted term, if any: from `laws`, or generic.

    `without_laws` is what remains without the laws.
    """

    found: Search
    unexplained: Unexplained
    term: Extension | None = None
    laws: Laws = field(default_factory=Laws)
    without_laws: Unexplained = field(default_factory=Unexplained)

    @property
    def generic(self) -> Extension | None:
        """The generic term, if it is one that extends the model."""
        return None if self.laws.found else self.term

    @property
    def only_reads_otherwise(self) -> bool:
        """Whether the model is extended only by laws of sensors."""
        return bool(self.laws.found) and not self.found.named and all(one.law.at.of_sensors for one in self.laws.found)

    def without_term(self) -> "Extended":
        """Return the same without its term, which made predictions worse."""
        if not self.laws.found:
            return replace(self, term=None)
        laws = Laws(reasons=(*self.laws.reasons, OF_NO_USE))
        return replace(self, term=None, laws=laws, unexplained=self.without_laws)

    @property
    def final(self) -> Fit:
        """The fit of the whole model."""
        return self.term.fit if self.term else self.found.final


def extended(problem: Problem, found: Search, held_out: Sequence[Segment] = ()) -> Extended:
    """Examine the residuals of a search, and extend the model if structure remains.

    Laws are tried first; they must hold in the `held_out` segments, or in a left-out part of the data. Effects are
    withdrawn if a law, or a generic term, predicts left-out data far better without them: they only imitated it.
    """
    unexplained = _unexplained(found)
    proposal = proposed(problem, found, held_out, unexplained.present)
    if proposal.extension:
        return _with_laws(found, proposal, unexplained)
    # One-step errors of a robot judged by free runs prove nothing.
    if problem.one_step and proposal.seen and not unexplained.present and not unexplained.not_judged:
        return Extended(found, structure_of(proposal.seen), laws=proposal.laws)
    if not unexplained.present:
        return Extended(found, unexplained, laws=proposal.laws)
    result = replace(_with_term(problem, found, unexplained), laws=proposal.laws)
    return result if problem.one_step or _matters(result) else Extended(found, Unexplained(), laws=proposal.laws)


def _with_laws(found: Search, proposal: Proposal, without: Unexplained) -> Extended:
    """Return the result with the laws in the model, and the structure remaining beside them and `without` them."""
    assert proposal.extension is not None
    assert proposal.before is not None
    assert proposal.problem is not None
    if proposal.withdrawn:
        found = _without_names(proposal.problem, found, BY_A_LAW, proposal.withdrawn, proposal.before)
    left = remaining(found.problem, proposal.extension.fit, found.base).unexplained
    if found.problem.one_step and proposal.seen and not without.present and not without.not_judged:
        without = structure_of(proposal.seen)
    return Extended(found, left, proposal.extension, proposal.laws, without)


def _matters(result: Extended) -> bool:
    """Return whether the structure beside free runs exceeds the usual odometry errors of real robots."""
    gained = result.term.gain.ratio if result.term else 1.0
    return result.unexplained.share > MUCH_UNEXPLAINED or gained > MUCH_GAINED


def _with_term(problem: Problem, found: Search, unexplained: Unexplained) -> Extended:
    """Return the result with the remaining structure, and the generic term that extends the model, if any."""
    beside = extension(found.problem, found.final)
    if found.named:
        alone = extension(problem, found.base)
        if alone and _makes_up_for(alone, beside, problem, found):
            left = remaining(problem, found.base, found.base).unexplained
            names = [one.candidate.effect.name for one in found.named]
            paper = _without_names(problem, found, WITHDRAWN, names, found.base)
            return Extended(paper, left if left.present else unexplained, alone)
    return Extended(found, unexplained, beside)


def _unexplained(found: Search) -> Unexplained:
    """Return the remaining structure; it must be there with and without the effects too small to be named.

    Their gain is not unexplained; but two of them that compensate each other may create structure.
    """
    fits = [with_small_effects(found)]
    fits += [found.final] if fits[0] is not found.final else []
    left = Unexplained()
    for fit in fits:
        left = remaining(found.problem, fit, found.base).unexplained
        if not left.present:
            break
    return left


def _without_names(problem: Problem, found: Search, why: str, names: Collection[str], final: Fit) -> Search:
    """Return the result as if some effects had not been named, with the reason `why`; `final` is without them."""
    leaving = [one for one in found.named if one.candidate.effect.name in names]
    others = [*((one.candidate, why) for one in leaving), *found.others]
    removed = [(one.candidate.effect.name, one.candidate.drop) for one in leaving]
    decisions = with_removed(found.decisions, removed, why)
    staying = [one for one in found.named if one not in leaving]
    extra_stds = found.extra_stds if staying else {}
    return replace(
        found, problem=problem, final=final, named=staying, others=others, extra_stds=extra_stds, decisions=decisions
    )


def _makes_up_for(alone: Extension, beside: Extension | None, problem: Problem, found: Search) -> bool:
    """Return whether a generic term alone predicts far better than the named effects, and as well as both together.

    It must not need more products than beside them, since the additional ones may imitate the effects. No error may be
    worse by as much as a term must gain to be accepted.
    """
    if beside and len(alone.names) > len(beside.names):
        return False
    named = _ratios(alone.fit, found.final, problem, found)
    both = _ratios(alone.fit, beside.fit, problem, found) if beside else named
    return min(named) < SURPASSED and max(*named, *both) < LEAST_GAIN


def _ratios(alone: Fit, named: Fit, problem: Problem, found: Search) -> list[float]:
    """Return the ratios of one model's free-run errors on left-out data to those with all named effects."""
    segments = [predictor.segment for predictor in problem.predictors]
    return list(measure(problem, alone, named, chance_of(found), segments, []).gain.signals.values())


def chance_of(found: Search) -> Mapping[str, float]:
    """Return values of parameters that are not fitted, because they are random."""
    return {name: estimate.value for one in found.named for name, estimate in one.estimates.items()}
