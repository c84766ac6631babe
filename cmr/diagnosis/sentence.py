"""The verdict of a diagnosis and its sentences."""

import math
from collections.abc import Sequence

from cmr.diagnosis.laws import laws_sentence
from cmr.diagnosis.result import EFFECTS_FOUND, GENERIC, LAW_FOUND, NO_EFFECT, UNEXPLAINED, Fitted, NamedEffect
from cmr.diagnosis.words import regressor_name, signal_name
from cmr.estimation.laws.result import Laws
from cmr.estimation.search.criteria import TOO_SMALL
from cmr.estimation.search.selection import Search
from cmr.estimation.unexplained.result import GenericTerm, Unexplained


def verdict_of(effects: Sequence[NamedEffect], laws: Laws, unexplained: Unexplained) -> str:
    """Return the verdict on usable data: named effects first, then laws."""
    if effects:
        return EFFECTS_FOUND
    if laws.found:
        return LAW_FOUND
    return UNEXPLAINED if unexplained.present else NO_EFFECT


def sentence_of(
    effects: Sequence[NamedEffect], laws: Laws, unexplained: Unexplained, search: Search, extended: Fitted | None
) -> str:
    """Return sentences on the result: effects, laws, and what remains."""
    path_rmse = extended.held_out_path_rmse if extended else math.nan
    causes = [effect.cause for effect in effects]
    found = " ".join([*causes, *filter(None, [laws_sentence(laws, path_rmse)])])
    if unexplained.present:
        goes_with = " and ".join(map(regressor_name, unexplained.regressors))
        signal = signal_name(str(unexplained.signal))
        rest = f"{'There remain errors' if found else 'There are errors'} that no effect of the catalogue explains: "
        sentence = f"{found} {rest}those of the {signal} depend on {goes_with}.".strip()
        return f"{sentence} {_generic_sentence(unexplained.generic)}" if unexplained.generic else sentence
    return found or _nothing(unexplained, search)


def _nothing(unexplained: Unexplained, search: Search) -> str:
    count = len(search.problem.possible)
    nothing = f"The data show none of the {count} effects in the catalogue"
    if any(why == TOO_SMALL for _, why in search.others):
        nothing = f"None of the {count} effects in the catalogue is large enough to matter here"
    if search.unseen:
        return f"{nothing}, but {len(search.unseen)} of them would not be visible in these drives."
    if unexplained.not_judged:
        return f"{nothing}. Whether the remaining errors have structure was not judged."
    return f"{nothing}: the paper's model is sufficient."


def _generic_sentence(term: GenericTerm) -> str:
    return f"The extended model has {GENERIC}, which improves its predictions of left-out data: {term.formula}."
