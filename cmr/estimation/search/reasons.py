"""The reasons for a search's decisions in words: the rows of its trace."""

from collections.abc import Iterator, Mapping, Sequence

from cmr.estimation.candidates import Excitation
from cmr.estimation.search.criteria import CandidateEffect, SelectedEffect, needed, too_small
from cmr.estimation.search.exchange import BETTER, Exchange, penalty_of
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.measures import too_small_to_be_named
from cmr.estimation.search.rivals import AS_WELL, Rival, margin_of
from cmr.estimation.search.trace import ADDED, INCLUDED, INDISTINCT, REJECTED, REPLACED, Row

LARGEST = "It has the largest likelihood ratio."
TOGETHER = "The likelihood ratio of these effects together is above the threshold."
STAYS = "Effects that are too small stay in the model only during the search, to hide no other effect."
NOTED = 4  # rejected effects per step kept in the trace


def rows_of_added(
    chosen: SelectedEffect,
    others: Sequence[tuple[CandidateEffect, str]],
    inflation: Inflation,
    excitation: Excitation,
) -> Iterator[Row]:
    """Yield the row of an effect that is added, and one for each of its rivals."""
    candidate, small = chosen.candidate, too_small(chosen.candidate, excitation)
    name, least = candidate.effect.name, least_of(candidate, inflation)
    reason = f"{small.sentence} {STAYS}" if small else LARGEST
    yield Row(INCLUDED if small else ADDED, [name], candidate.drop, least, reason, [small])
    margin = margin_of(candidate, inflation)
    for rival in (other for other, _ in others if other.effect.name in chosen.rivals):
        less = candidate.drop - rival.drop
        yield Row(INDISTINCT, [rival.effect.name, name], less, margin, AS_WELL.format(name))


def row_of_exchange(exchange: Exchange, drop: float, inflation: Inflation, excitation: Excitation) -> Row:
    """Return the row of an exchange that lowers the sum of squares by `drop`; its effects may be too small to name."""
    found = [too_small(one.candidate, excitation) for one in exchange.selected]
    small = [measure for measure in found if measure]
    reason = f"In place of {' and '.join(exchange.leaving)}." if exchange.leaving else TOGETHER
    reason = f"{reason} {too_small_to_be_named(small)} {STAYS}" if small else reason
    action = REPLACED if exchange.leaving else INCLUDED if len(small) == len(found) else ADDED
    least = penalty_of(exchange.leaving, exchange.coming, inflation) + BETTER * inflation.all
    return Row(action, exchange.coming, drop, least, reason, small)


def rows_of_rejected(others: Sequence[tuple[CandidateEffect, str]], inflation: Inflation) -> Iterator[Row]:
    """Yield the rows of the rejected effects with the largest drops, with the reasons."""
    for candidate, why in sorted(others, key=lambda other: -other[0].drop)[:NOTED]:
        least, reason = least_of(candidate, inflation), candidate.reason(why)
        yield Row(REJECTED, [candidate.effect.name], candidate.drop, least, reason, [candidate.measure])


def rows_of_rivals(rivals: Mapping[str, Sequence[Rival]]) -> Iterator[Row]:
    """Yield a row for each rival of an effect, by name."""
    for name, own in rivals.items():
        for rival in own:
            yield Row(INDISTINCT, [rival.name, name], rival.less, rival.limit, AS_WELL.format(name))


def least_of(candidate: CandidateEffect, inflation: Inflation) -> float:
    """Return the drop of the sum of squares below which an effect may be chance."""
    return needed(candidate.effect) * inflation.of(candidate.effect.name)
