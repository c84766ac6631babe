"""Select the effects that the data show, and fit the model with them (stepwise selection).

From the paper's model on, each step

1. screens all effects beside the model (screening.py),
2. adds the effect that explains most, if it also predicts data on which it was not fitted (ranking.py, ties.py), or
3. exchanges effects if others explain more (exchange.py), or leaps to a likelier set (leap.py), and
4. removes effects that the others make redundant (`pruned` of elimination.py).

If none of this improves the model, but a rival explains more than its effect (rivals.py), it takes the effect's place,
and the steps go on.

A set visited before is accepted again only if its sum of squares is lower by BETTER, so the search terminates. When
nothing improves any more, each effect is judged once more beside all others (`finished` of elimination.py). Random
effects on the commands are not fitted: they are detected in the residuals, removed from the data, and the search starts
again (chance.py).

Reference: M. A. Efroymson, in Ralston and Wilf, Mathematical Methods for Digital Computers, 1960.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.estimation.averaging import Averaging, relinearised
from cmr.estimation.gains import COARSE
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.adding import next_effect
from cmr.estimation.search.chance import chance_on_commands, coarse_ticks, tick_of, with_jitter_as_rival
from cmr.estimation.search.criteria import (
    THRESHOLD,
    TOO_SMALL,
    CandidateEffect,
    SelectedEffect,
    measured,
    needed,
)
from cmr.estimation.search.elimination import finished, pruned
from cmr.estimation.search.exchange import BETTER, Exchange, best_exchange
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.leap import best_leap
from cmr.estimation.search.measures import coarse_tick
from cmr.estimation.search.reasons import row_of_exchange, rows_of_added, rows_of_rejected, rows_of_rivals
from cmr.estimation.search.rivals import Rival, better_than, rivals_of
from cmr.estimation.search.screening import Screening, screen
from cmr.estimation.search.trace import ADDED, REJECTED, REMOVED, Decision, Row, Trace
from cmr.estimation.simulation_error import FREE_RUN_INFLATION
from cmr.model.catalogue import CATALOGUE

MOST_EFFECTS = 12  # with those that are too small to be named
FEW = 3  # effects; with so few, exchanges have tried nearly all sets
MOST_STEPS = 30  # additions and exchanges
AS_BEFORE = "The search has been at this model before, and fits it no better now."
CLEANED = "What it did is removed from the data, and the search starts again."
REDUNDANT = "The other effects explain nearly as much without it."
SMALLER_SHOWN = 0.5  # of the typical size: an effect is unseen if only larger sizes would be detected
MOST_SMALL = 8  # such effects that are fitted to see what remains
COARSE_INFLATION = 40.0  # quantisation errors of coarse encoders depend on the speed
LEFT_BY_CHANCE = 0.05  # of a random effect's drop that may remain, because the delays of single commands are inexact
MUCH = 5.0  # times the required drop: if a second effect explains more, there may be several


@dataclass(frozen=True)
class Search:
    """The result of a search: the fitted paper's model, the final fit, the effects in order, and the runners-up.

    `problem` contains the recordings with random effects removed. `extra_stds` add to the standard deviations of some
    parameters. `unseen` are effects that would not show in these drives. `decisions` are the steps of the search.
    `seen` is the fit with the effects that are too small to be named.
    """

    problem: Problem
    base: Fit
    final: Fit
    named: list[SelectedEffect]
    others: list[tuple[CandidateEffect, str]]
    inflation: float
    extra_stds: Mapping[str, float]
    unseen: tuple[str, ...]
    decisions: tuple[Decision, ...] = ()
    seen: Fit | None = None


def search(
    problem: Problem,
    base: Fit,
    say: Callable[[str], None],
    of_use: Callable[[Search], bool] = lambda _found: True,
    after_step: Callable[[Fit], None] = lambda _fit: None,
) -> Search:
    """Select effects until nothing significant is left; `after_step` is called with the fit of each model on the way.

    Random effects on the commands are detected in the residuals. They are removed from the data and the search starts
    again, if the result so far is `of_use`. Raises what `after_step` raises, to end the search.
    """
    trace = Trace()
    found = _selected(_Selection(problem, base, trace), say, after_step)
    chance = None
    if problem.one_step and tick_of(problem) <= COARSE:
        chance = chance_on_commands(problem, found.named, found.others, found.final, found.seen or found.final)
    if chance is None or not of_use(found):
        named = with_jitter_as_rival(problem, found.named, found.final)
    else:
        by_chance, cleaned = chance
        name = by_chance.candidate.effect.name
        say(f"Searching again without {name} ...")
        trace.note(Row(ADDED, [name], by_chance.candidate.drop, reason=CLEANED))
        clean_base = cleaned.fit(base.values, base.names, found.final.noise, renew=0)
        least = LEFT_BY_CHANCE * by_chance.candidate.drop / THRESHOLD
        found = replace(_selected(_Selection(cleaned, clean_base, trace, least), say, after_step), base=base)
        named = with_jitter_as_rival(cleaned, [by_chance, *found.named], found.final)
    coarse = coarse_ticks(problem, found.final)
    if coarse:
        ticks = coarse_tick(tick_of(problem), COARSE)
        trace.note(
            Row(ADDED, [coarse.candidate.effect.name], coarse.candidate.drop, reason=ticks.sentence, measures=[ticks])
        )
        named = [*named, coarse]
    named = sorted(named, key=lambda one: -one.candidate.drop)
    return replace(found, named=named, decisions=tuple(trace.decisions))


class _Selection:
    """The current model of a search: its fit, the selected effects, and the latest rejections.

    The inflation of effects visible in the wheels is at least `least_inflation`.
    """

    def __init__(self, problem: Problem, base: Fit, trace: Trace, least_inflation: float = 1.0) -> None:
        self.problem, self.trace = problem, trace
        self.base = self.current = base
        self.named: list[SelectedEffect] = []
        self.others: list[tuple[CandidateEffect, str]] = []
        self.inflation = Inflation(1.0)
        self._least_inflation = least_inflation
        self._visited: dict[frozenset[str], float] = {frozenset(): base.squares}
        self._ahead_tried = False
        self._afar: Averaging | None = None
        self._exchanged_for: set[str] = set()

    @property
    def names(self) -> list[str]:
        """The names of the effects selected."""
        return [one.candidate.effect.name for one in self.named]

    def screened(self) -> Screening:
        """Screen all effects beside the model; the model is fitted with the noise that the screening found."""
        screening = screen(
            self.problem,
            self.current.values,
            self.current.names,
            self.names,
            self.current.noise if self.named else None,
        )
        self.current = self.problem.renewed(self.current, screening.noise)
        inflation = screening.inflation.at_least(COARSE_INFLATION if tick_of(self.problem) > COARSE else 1.0)
        # The screening classifies the others; the selected ones keep their status.
        body = inflation.body | (self.inflation.body & {*self.names})
        inflation = replace(inflation, all=max(inflation.all, self._least_inflation), body=body)
        self.inflation = inflation if self.problem.one_step else Inflation(FREE_RUN_INFLATION)
        return screening

    def improved(self, screening: Screening) -> bool:
        """Add the best effect or make the best exchange; return whether there was one that leads to a new model.

        If much remains beside the first effect, there are several: adding them at once saves most of the work.
        """
        much = MUCH * THRESHOLD * self.inflation.all
        much_left = any(score.drop > much for score in screening.scores[:1])
        if len(self.named) == 1 and much_left and self.problem.one_step and not self._ahead_tried:
            self._ahead_tried = True
            # The likeliest model reached from the current one, without a search.
            ahead = [relinearised(self.problem, self.current, self.inflation.all)[0]]
            if self._exchanged(best_leap(self.problem, self.current, self.named, self.inflation, ahead)):
                return True
        chosen, self.others = next_effect(self.problem, self.current, screening, self.inflation)
        if chosen is not None and len(self.named) < MOST_EFFECTS:
            assert chosen.candidate.fit is not None
            rows = rows_of_added(chosen, self.others, self.inflation, self.problem.excitation)
            return self._exchanged(Exchange((), (chosen,), chosen.candidate.fit), list(rows))
        self.others = [
            (measured(self.problem, self.current, candidate, self.inflation, why), why)
            for candidate, why in self.others
        ]
        self.trace.note(*rows_of_rejected(self.others, self.inflation))
        if not self.problem.one_step:  # among effects alike in free runs, keep the one that predicts left-out data best
            return False
        exchange = best_exchange(self.problem, self.current, screening, self.named, self.inflation)
        if self._exchanged(exchange):
            return True
        # If nothing remains, and exchanges reach nearly all sets, no walk is needed.
        about = () if self.inflation.all <= 1.0 and len(self.named) <= FEW else self._near_and_afar()
        return self._exchanged(best_leap(self.problem, self.current, self.named, self.inflation, about))

    def _near_and_afar(self) -> Iterator[Averaging]:
        """Yield the linear problem about the current model, then, on demand, the one that is independent of the search:
        about the likeliest model reached from the paper's.
        """
        yield Averaging(self.problem, self.current, self.inflation.all, self.names)
        if self._afar is None:
            self._afar = relinearised(self.problem, self.base, 1.0)[0]
        yield self._afar

    def _exchanged(self, exchange: Exchange | None, added: Sequence[Row] = ()) -> bool:
        """Make an exchange, if there is one, and remove what it makes redundant; return whether the model is new.

        An addition is an exchange that removes nothing, with its own rows for the trace.
        """
        if exchange is None:
            return False
        if not added:
            self._exchanged_for.update(exchange.coming)
            drop = self.current.squares - exchange.fit.squares
            added = [row_of_exchange(exchange, drop, self.inflation, self.problem.excitation)]
        self.trace.note(*added)
        stay = [one for one in self.named if one.candidate.effect.name not in exchange.leaving]
        named, fit = [*stay, *exchange.selected], exchange.fit
        if len(named) > 1:
            named, fit, redundant = pruned(self.problem, named, fit, self.inflation)
            self.trace.note(*(Row(REMOVED, [name], drop, least, REDUNDANT) for name, drop, least in redundant))
        after = frozenset(one.candidate.effect.name for one in named)
        gained = self._visited.get(after, np.inf) - fit.squares
        if gained < BETTER:
            self.trace.note(Row(REJECTED, sorted(after), gained, BETTER, AS_BEFORE))
            return False
        self._visited[after] = fit.squares
        self.named, self.current = named, fit
        self.trace.step += 1
        return True

    def rivals(self, screening: Screening) -> dict[str, tuple[Rival, ...]]:
        """Return the rivals of the selected effects beside all others, by name.

        A former rival may no longer explain as much once other effects are found.
        """
        found = {}
        for one in self.named:
            name = one.candidate.effect.name
            if name in self._exchanged_for or (one.rivals and self.problem.one_step):
                found[name] = rivals_of(self.problem, self.current, screening, one, self.inflation)
        return found

    def exchanged_for_one_of(self, rivals: Mapping[str, Sequence[Rival]]) -> bool:
        """Replace an effect by a rival that explains more; return whether this led to a new model.

        This happens if a fit got stuck.
        """
        better = (better_than(self.problem, self.current, name, own, self.inflation) for name, own in rivals.items())
        return any(self._exchanged(exchange) for exchange in better)

    def with_rivals(self, rivals: Mapping[str, Sequence[Rival]]) -> list[SelectedEffect]:
        """Return the selected effects with these rivals."""
        found = {name: tuple(rival.name for rival in own) for name, own in rivals.items()}
        return [replace(one, rivals=found.get(one.candidate.effect.name, one.rivals)) for one in self.named]


def _selected(state: _Selection, say: Callable[[str], None], after_step: Callable[[Fit], None]) -> Search:
    """Select effects, without random ones."""
    problem, trace = state.problem, state.trace
    screening = state.screened()
    for _ in range(MOST_STEPS):
        taken = ", ".join(state.names) or "the paper's model"
        say(f"Testing {len(problem.effects) - len(state.names)} effects beside {taken} ...")
        if not state.improved(screening) and not state.exchanged_for_one_of(rivals := state.rivals(screening)):
            break
        after_step(state.current)
        screening = state.screened()
    else:
        rivals = state.rivals(screening)
    trace.note(*rows_of_rivals(rivals))
    last = finished(problem, state.with_rivals(rivals), state.current, state.inflation)
    for candidate, why in last.dropped:
        reason, measures = candidate.reason(why), [candidate.measure]
        trace.note(Row(REMOVED, [candidate.effect.name], candidate.drop, reason=reason, measures=measures))
    others = [*last.dropped, *state.others]
    unseen = _unseen(problem, screening, [one.candidate.effect.name for one in last.named])
    return Search(
        problem,
        state.base,
        last.final,
        last.named,
        others,
        state.inflation.all,
        last.extra_stds,
        unseen,
        seen=state.current,
    )


def _unseen(problem: Problem, screening: Screening, named: Collection[str]) -> tuple[str, ...]:
    """Return effects undetectable in these drives at half their typical size, and those that cannot be tested."""
    tested = {effect.name for effect in problem.effects}
    shown = {
        name
        for name, effect in CATALOGUE.items()
        if SMALLER_SHOWN**2 * screening.traces.get(name, np.inf) >= needed(effect) * screening.inflation.of(name)
    }
    possible = [effect.name for effect in problem.possible]
    return tuple(name for name in possible if name not in named and not (name in tested and name in shown))


def small_effects(found: Search) -> list[CandidateEffect]:
    """Return the MOST_SMALL largest effects that are significant but too small to be named."""
    return [candidate for candidate, why in found.others if why == TOO_SMALL][:MOST_SMALL]


def with_small_effects(found: Search) -> Fit:
    """Return the final fit with the significant effects that are too small to be named.

    Their gain does not count as unexplained.
    """
    small = small_effects(found)
    if not small:
        return found.final
    own = {name: one.values[name] for one in small for name in (p.name for p in one.effect.parameters)}
    names: Sequence[str] = (*found.final.names, *own)
    return found.problem.fit({**found.final.values, **own}, names, found.final.noise, renew=0)
