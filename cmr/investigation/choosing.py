"""Choose the next movement: one that keeps to the floor and best separates the remaining explanations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from cmr.estimation.candidates import AS_THE_RADIUS, Trial, is_rough, lanes_of, size, trials
from cmr.estimation.gauss_newton import moves_of
from cmr.estimation.problem import LARGE, temper
from cmr.estimation.search.screening import changes_of
from cmr.investigation import separation
from cmr.investigation.floor import Floor
from cmr.investigation.judging import NAMED, NOTHING, OPEN, Judgement, own_parameters
from cmr.investigation.movements import Movement, Random, candidates, towards
from cmr.investigation.prediction import Situation, changes, paths, times_of
from cmr.investigation.reckoning import Reckoned
from cmr.investigation.separation import ENOUGH, ENOUGH_UNSEEN, LEAST_WEIGHT, Columns
from cmr.model.catalogue import CATALOGUE, definition
from cmr.model.effect import Effect
from cmr.recordings.signal import Floats

PREDICTED = 36  # movements that keep to the floor, whose information is predicted
SLOWER, UNEQUAL = 0.95, 0.03  # k1, and difference of the two sides' gains, of robots that must stay on the floor
MOST_AS_FITTED = 2  # further explanations that must stay on it
SEEN = 30.0  # squared distance at which an existing effect would have shown, whatever the data say
LEFT = 0.01  # share of the distance below which other effects count as imitating it
DISGUISED = 1e-4  # the same share for the robot's own parameters: below it, the effect is not distinguished from them
QUIET = 0.75  # share of effects that must have shown before movements are chosen for the others only
UNHURRIED = 1.5  # s of a movement at least while only these are left: no decision is urgent then
EVIDENT = 6.0  # evidence from which an explanation counts as seen
SAME = frozenset(map(frozenset, combinations(AS_THE_RADIUS, 2)))  # the same mathematics: k1 makes up for it


@dataclass(frozen=True)
class Evidence:
    """Information that the data contain about each effect, and the columns that belong to each.

    `contrary` is twice the logarithm of the odds against each effect at its usual size, by name. The effects in
    `imitated` would have shown by now if the named ones together could not imitate them. Those in `disguised` would
    have shown if they did not look like another value of one of the robot's own parameters, by effect. No movement is
    chosen for those in `hopeless`. An effect in `unconfirmed` still needs this evidence from new data before it is
    named, whatever its odds.
    """

    information: Floats
    columns: Columns
    sets: tuple[Mapping[str, float], ...]
    contrary: Mapping[str, float] = field(default_factory=dict)
    imitated: frozenset[str] = frozenset()
    disguised: Mapping[str, str] = field(default_factory=dict)
    hopeless: frozenset[str] = frozenset()
    unconfirmed: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def seen(self) -> dict[str, float]:
        """The squared distance at which each effect would show, at its usual size, by name."""
        own = separation.own(separation.projected(self.information, self.columns), self.columns)
        return dict(zip(self.columns.names, own.tolist(), strict=True))

    @cached_property
    def shown(self) -> frozenset[str]:
        """The effects that would have shown by now at their usual size, if they were there."""
        names = self.columns.names
        return frozenset(n for n in names if self.seen[n] >= SEEN or self.contrary.get(n, 0.0) >= NAMED)


@dataclass(frozen=True)
class Choice:
    """The next movement, its `worth`, and its predicted places (n, members, 2) [m; world frame].

    `movement` is None if no candidate keeps to the floor. `parted` are the two explanations that it separates most.
    `best_rates` are the squared distances [1/s] that the best candidate for each effect adds, by name.
    """

    movement: Movement | None
    worth: float = 0.0
    path: Floats | None = None
    parted: tuple[str, str] = (NOTHING, NOTHING)
    best_rates: Mapping[str, float] = field(default_factory=dict)


def evidence_of(judgement: Judgement, time: float) -> Evidence:
    """Return the information of the data so far; effects with an unseen start begin at `time` [s]."""
    sets, columns = _column_sets(judgement, time)
    problem = judgement.problem
    white = judgement.noise.all_white(problem.batch, changes_of(problem.joint_errors(lanes_of(sets))))
    errors = np.ascontiguousarray(white[:, 0])
    temper(errors, LARGE)
    white[:, 0] = errors
    products = np.nan_to_num(white.T @ white)
    for number, name in enumerate(problem.own, 1):
        if name in problem.prior:
            mean, std = problem.prior[name]
            step = (sets[number][name] - sets[0][name]) / std
            products[number, number] += step**2
            products[[0, number], [number, 0]] += step * (sets[0][name] - mean) / std
    known = products[1:, 1:]
    imitated = _imitated(known, columns, len(problem.own))
    disguised = _disguised(known, Columns(len(problem.own), columns.of), problem.own)
    hopeless = imitated | {*disguised}
    return Evidence(known, columns, tuple(sets), _contrary(products, columns), imitated, disguised, hopeless)


def _contrary(products: Floats, columns: Columns) -> dict[str, float]:
    """Return twice the logarithm of the odds against each effect at its usual size, by name.

    `products` (1 + m, 1 + m) are those of the remaining errors and the columns.
    """
    last = np.roll(products, -1, axis=(0, 1))  # the errors after the columns
    left = separation.projected(last, columns)
    one_sided = [name for name in columns.names if _is_one_sided(CATALOGUE[name])]
    found = separation.against(left[:-1, :-1], left[:-1, -1], columns, one_sided)
    return dict(zip(columns.names, found.tolist(), strict=True))


def _is_one_sided(effect: Effect) -> bool:
    """Return whether an effect can have one sign only."""
    switches = [parameter for parameter in effect.parameters if parameter.switches]
    return all(parameter.is_limit or parameter.lower == parameter.neutral for parameter in switches)


def only(known: Evidence, names: Sequence[str]) -> Evidence:
    """Return the information on some effects only."""
    kept, of = [*range(known.columns.free)], {}
    for name in names:
        of[name] = tuple(range(len(kept), len(kept) + len(known.columns.of[name])))
        kept += known.columns.of[name]
    sets = (known.sets[0], *(known.sets[1 + column] for column in kept))
    information = known.information[np.ix_(kept, kept)]
    return replace(known, information=information, columns=Columns(known.columns.free, of), sets=sets)


def _imitated(known: Floats, columns: Columns, own: int) -> frozenset[str]:
    """Return the effects that the named ones nearly reproduce; the first `own` columns are the robot's own."""
    beside, alone = (separation.own(separation.projected(known, of), of) for of in (columns, Columns(own, columns.of)))
    gone = (alone > SEEN) & (beside < np.minimum(LEFT * alone, SEEN))
    return frozenset(name for name, one in zip(columns.names, gone, strict=True) if one)


def _disguised(known: Floats, columns: Columns, own: Sequence[str]) -> dict[str, str]:
    """Return the effects that the robot's own parameters reproduce, each with the parameter that it looks like.

    Without poses, a gyro that reads too much looks like a wider base; with them, other columns separate the two.
    """
    whole, left = (separation.own(of, columns) for of in (known, separation.projected(known, columns)))
    sizes = np.maximum(np.diagonal(known), 1e-300)
    result = {}
    for number, name in enumerate(columns.names):
        if whole[number] > SEEN and left[number] < DISGUISED * whole[number]:
            alike = np.sum(known[: len(own), list(columns.of[name])] ** 2, axis=1) / sizes[: len(own)]
            result[name] = own[int(np.argmax(alike))]
    return result


def choose(
    judgement: Judgement,
    known: Evidence,
    situation: Situation,
    floor: Floor,
    random: Random,
    at_random: bool = False,
    least: float = 0.0,
    reckoned: Reckoned | None = None,
) -> Choice:
    """Return the best of many movements of `least` [s] or longer; they are longer if nothing is suspected.

    `at_random` takes the first that keeps to the floor, for comparison. Without poses (`reckoned`), the uncertainty of
    the robot's position stays on the floor, too.
    """
    is_quiet = _is_quiet(judgement, known)
    if is_quiet:
        known, least = only(known, _may_show(known)), max(least, UNHURRIED)
    drawn = _drawn(judgement.best.values, situation, floor, random, least)
    kept = [
        (movement, path)
        for movement, path in zip(drawn, paths(situation, drawn, ensemble(judgement)), strict=True)
        if keeps_to(floor, path, _doubts(reckoned, path))
    ]
    if not kept:
        return Choice(None)
    if at_random:
        return Choice(kept[0][0], 0.0, kept[0][1][..., :2])
    kept = kept[: PREDICTED - 6] + kept[-6:] if len(kept) > PREDICTED else kept
    movements = [movement for movement, _ in kept]
    told_by = changes(situation, movements, known.sets, judgement.problem.gains, judgement.noise)
    added = np.stack([np.nan_to_num(one.T @ one) for one in told_by])
    seconds = np.array([movement.seconds for movement in movements])
    worth, need, gained, weights = _worth(judgement, known, added, seconds, is_quiet)
    number = int(np.argmax(worth))
    names = known.columns.names
    pair = _parted(names, need, gained[number], weights)
    rates = np.max(np.diagonal(gained, axis1=1, axis2=2) / seconds[:, None], axis=0)
    best_rates = dict(zip(names, rates.tolist(), strict=True))
    return Choice(movements[number], float(worth[number]), kept[number][1][..., :2], pair, best_rates)


def _drawn(
    values: Mapping[str, float], situation: Situation, floor: Floor, random: Random, least: float
) -> list[Movement]:
    """Return random movements, and some towards the middle of the floor, of `least` [s] or longer."""
    x, y, *_ = situation.state
    away = float(np.hypot(floor.middle[0] - x, floor.middle[1] - y))
    top = values["wheel_radius"] / values["k1"]
    return [*candidates(random, least=least), *towards(max(away, 0.1), top, random, least)]


def keeps_to(floor: Floor, path: Floats, doubt: Floats | float = 0.0) -> bool:
    """Return whether all places (n, members, 2 or 3) of a path lie on the floor, `doubt` (n,) [m] further inside."""
    room = floor.room(path[..., 0], path[..., 1])
    return bool(np.all(room >= np.broadcast_to(doubt, len(path))[:, None]))


def _doubts(reckoned: Reckoned | None, path: Floats) -> Floats | float:
    """Return the possible distance of the robot from each place [m], (n,); 0 where poses are reported."""
    if reckoned is None:
        return 0.0
    return reckoned.doubts(times_of(path), path[:, 0])


def ensemble(judgement: Judgement) -> list[dict[str, float]]:
    """Return the robots that must stay on the floor: the best, faster and uneven ones, and the next explanations."""
    best = dict(judgement.best.values)
    uneven = [
        {**best, "k1": SLOWER * best["k1"], "motor_gain_asymmetry": best.get("motor_gain_asymmetry", 0.0) + change}
        for change in (-UNEQUAL, UNEQUAL)
    ]
    others = [dict(one.values) for one in judgement.explanations[1 : 1 + MOST_AS_FITTED]]
    return [best, *uneven, *others]


def worth_of(judgement: Judgement, known: Evidence, added: Floats, seconds: Floats) -> Floats:
    """Return the worth (c,) of candidates that add information `added` (c, m, m) in `seconds` (c,)."""
    return _worth(judgement, known, added, seconds, _is_quiet(judgement, known))[0]


def _worth(
    judgement: Judgement, known: Evidence, added: Floats, seconds: Floats, is_quiet: bool
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the worth of candidates (c,), each pair's need (e, e) and gain (c, e, e), and the weights (e,)."""
    before, after = (
        separation.separations(separation.projected(information, known.columns), known.columns)
        for information in (known.information, known.information + added)
    )
    need, weights = _needs(judgement, known, before)
    gained = after - before
    if is_quiet:
        alone = np.diagonal(need)
        need = np.where(np.eye(len(alone), dtype=bool), need, np.inf)
        return separation.progress(np.diagonal(gained, axis1=1, axis2=2), alone, seconds), need, gained, weights
    return separation.scores(before, after, need, weights, seconds), need, gained, weights


def _is_quiet(judgement: Judgement, known: Evidence) -> bool:
    """Return whether only a few effects have yet to show, and no relevant one is suspected."""
    names = known.columns.names
    seen = [name for name in names if _evidence(judgement, name) > EVIDENT and not _is_settled(judgement, name)]
    return bool(_may_show(known)) and not seen and len(known.shown) > QUIET * len(names)


def _may_show(known: Evidence) -> list[str]:
    """Return the effects that have not shown yet and still may; one with a start time may always come."""
    names = [name for name in known.columns.names if CATALOGUE[name].locality != "time"]
    return [name for name in names if name not in known.shown and name not in known.hopeless]


def _needs(judgement: Judgement, known: Evidence, before: Floats) -> tuple[Floats, Floats]:
    """Return the remaining need of each pair of explanations, (e, e), infinite if none, and the effects' weights.

    A pair of which both would have shown, and did not, needs no separation.
    """
    names = known.columns.names
    evidence = np.array([_evidence(judgement, name) for name in names])
    left = {one.name for one in judgement.left}
    settled = np.array(
        [name not in known.unconfirmed and (name in known.hopeless or _is_settled(judgement, name)) for name in names]
    )
    shown = np.array([name in known.shown for name in names])
    is_left = np.array([name in left for name in names]) & ~settled
    need = np.full(before.shape, np.inf)
    both = is_left[:, None] & is_left[None, :]
    apart = np.where(
        np.maximum(evidence[:, None], evidence[None, :]) > EVIDENT,
        ENOUGH - np.abs(evidence[:, None] - evidence[None, :]),
        ENOUGH_UNSEEN - before,
    )
    excluded = shown & (evidence <= EVIDENT)
    both &= ~(excluded[:, None] & excluded[None, :])
    need[both] = apart[both]
    against = np.array([known.contrary.get(name, 0.0) for name in names])
    unshown = np.minimum(SEEN - np.diagonal(before), NAMED - against)
    index = np.arange(len(names))
    unseen = np.where(evidence > EVIDENT, ENOUGH - evidence, np.where(shown, 0.0, unshown))
    need[index, index] = unseen
    for i, one in enumerate(names):
        for j, other in enumerate(names):
            if frozenset((one, other)) in SAME:
                need[i, j] = np.inf
    for i, name in enumerate(names):
        need[i, i] = max(need[i, i], known.unconfirmed.get(name, 0.0))
    need[(need <= 0.0) | settled[:, None]] = np.inf
    behind = np.minimum(evidence, 0.0) if judgement.best.name == NOTHING else evidence - judgement.best.evidence
    weights = np.maximum(np.exp(np.maximum(behind, -OPEN * 4.0) / 8.0), LEAST_WEIGHT)
    return need, weights


def _is_settled(judgement: Judgement, name: str) -> bool:
    """Return whether no movement is worth driving for an effect.

    Either it is seen, at a size that does not matter; or it has a start time and is not seen, so it may always come.
    """
    one = judgement.of(name)
    if one is None or one.evidence <= EVIDENT:
        return CATALOGUE[name].locality == "time"
    return not judgement.is_large(name, one.values)


def _evidence(judgement: Judgement, name: str) -> float:
    found = judgement.of(name)
    return found.evidence if found is not None else 0.0


def _parted(names: Sequence[str], need: Floats, gained: Floats, weights: Floats) -> tuple[str, str]:
    """Return the two explanations whose need a candidate fills most, the likelier ones first."""
    share = np.where(np.isfinite(need), np.minimum(gained / np.where(np.isfinite(need), need, 1.0), 1.0), 0.0)
    i, j = np.unravel_index(int(np.argmax(share * weights[:, None])), share.shape)
    return names[int(i)], NOTHING if i == j else names[int(j)]


def _column_sets(judgement: Judgement, time: float) -> tuple[list[dict[str, float]], Columns]:
    """Return the values whose errors are compared: the best model, its parameters moved, then effects switched on."""
    problem, base = judgement.problem, dict(judgement.base.values)
    free = (*problem.own, *(n for n in own_parameters(judgement.named) if definition(n).switches))
    moves = moves_of(base, free, problem.excitation)
    sets = [base, *({**base, name: base[name] + move} for name, move in zip(free, moves, strict=True))]
    of: dict[str, tuple[int, ...]] = {}
    # Use the usual size if the fitted one is insignificant.
    left = {
        one.name: one
        for one in judgement.left
        if one.fitted and one.evidence > 0.0 and judgement.is_large(one.name, one.values)
    }
    for effect in problem.effects:
        if effect.name in judgement.named or effect.beside:
            continue
        if effect.name in left and (is_rough(effect) or effect.locality):
            own: list[Mapping[str, float]] = [_own(effect, left[effect.name].values)]
        else:
            own = [trial.values for trial in _usual_trials(judgement, effect, time)]
        if own:
            of[effect.name] = tuple(range(len(sets) - 1, len(sets) - 1 + len(own)))
            sets += [{**base, **values} for values in own]
    return sets, Columns(len(free), of)


def _own(effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    return {parameter.name: values[parameter.name] for parameter in effect.parameters if parameter.name in values}


def _usual_trials(judgement: Judgement, effect: Effect, time: float) -> list[Trial]:
    """Return the trials of an effect at its usual size; one with a start time begins now."""
    excitation = judgement.problem.excitation
    result = []
    for trial in trials(excitation, [effect]):
        usual = [
            abs(trial.values[p.name])
            for p in effect.parameters
            if p.switches and not p.is_neutral(trial.values[p.name])
        ]
        sizes = [
            trial.portion * abs(size(p, excitation))
            for p in effect.parameters
            if p.switches and not p.is_neutral(trial.values[p.name])
        ]
        if trial.spare or not np.allclose(usual, sizes, rtol=1e-6):
            continue
        if trial.local == "time":
            trial = Trial(
                trial.effect, {**trial.values, effect.parameter_of("time"): time}, trial.threshold, trial.local
            )
        result.append(trial)
    return result
