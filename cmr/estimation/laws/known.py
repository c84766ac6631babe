"""Exclude laws that are equivalent to an effect of the catalogue.

There is no list of equivalent formulas. Each effect of the catalogue is applied at its typical and at a small size, and
the resulting changes of the errors are compared with the traces of a law. This also finds identities, such as that
between the scale of poses and the wheel radius. The small size matters because residuals of a search are small, while a
large effect may hold a wheel for longer than a small force.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cmr.estimation.candidates import Trial, is_rough, lanes_of, trials
from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.linearised import Linearised, mixed, seen_in
from cmr.estimation.laws.rest import Rest
from cmr.estimation.laws.scan import LEAST_OWN
from cmr.estimation.search.screening import changes_of
from cmr.model.catalogue import CATALOGUE, definition
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.recordings.signal import Floats

SMALL = 0.1  # of the usual size, at which an effect is compared with a law, too
ALIKE = 0.985  # share of a law's own trace that one effect reproduces: they are then equivalent on this drive
# The same for whole traces, including the directions of the model's parameters. What is orthogonal to these may be so
# small that the difference between a variable of the observer and one of the model counts: a gyro's scale beside the
# base width.
SAME = 0.995
# The same for an effect in the model: beside it, the law would only describe its behaviour near rest, and shift its
# size.
ALIKE_IN_MODEL = 0.9


@dataclass(frozen=True)
class Known:
    """The traces of effects beside a model: orthonormal columns (n, k), and the gain of each, by its name.

    An effect has columns for each size tested, if it has parameters besides its size. `whole` are the same columns,
    including the directions of the model's parameters.
    """

    columns: list[tuple[str, Floats]]
    whole: list[tuple[str, Floats]]
    gains: dict[str, float]
    rest: Rest

    def same_as(self, model: Linearised, law: Candidate) -> str:
        """Return the name of the effect that is equivalent to a law; empty if there is none."""
        traces = _traces_of(model, law, self.rest)
        return _alike(traces, self.rest.basis, self.columns) or _alike(traces, traces[:, :0], self.whole, SAME)


class Catalogued:
    """The effects of the catalogue beside a model with the residuals `rest` and the effects `selected`, computed on
    demand.
    """

    def __init__(self, model: Linearised, rest: Rest, selected: Sequence[str]) -> None:
        self.model = model
        self._rest, self._selected = rest, selected

    @cached_property
    def effects(self) -> Known:
        """The traces of the effects."""
        return known_beside(self.model, self._rest, self._selected)

    def has(self, law: Candidate) -> bool:
        """Return whether an effect is equivalent to a law: one in the model, or another one."""
        return self.is_of_model(law) or bool(self.effects.same_as(self.model, law))

    def is_of_model(self, law: Candidate) -> bool:
        """Return whether an effect of the model is equivalent to a law: having both would be redundant."""
        basis, columns = self._selected_columns
        return bool(columns and _alike(_traces_of(self.model, law, self._rest), basis, columns, ALIKE_IN_MODEL))

    @cached_property
    def _selected_columns(self) -> tuple[Floats, list[tuple[str, Floats]]]:
        """The traces of the paper's parameters, orthonormal (n, p), and of each effect of the model beside them."""
        model, mask = self.model, self._rest.mask[:, None]
        slopes = model.problem.made_white(model.slopes, self._rest.noise) * mask
        basis = np.linalg.qr(slopes[:, [name in PAPER for name in model.names]])[0]
        columns = []
        for effect in self._selected:
            own = {parameter.name for parameter in CATALOGUE[effect].parameters}
            moves = slopes[:, [name in own for name in model.names]]
            part = _orthonormal(moves - basis @ (basis.T @ moves), moves)
            columns += [(effect, part)] if part.shape[1] else []
        return basis, columns

    @cached_property
    def best(self) -> float:
        """The gain of the best effect, to first order."""
        return max(self.effects.gains.values(), default=0.0)


def _traces_of(model: Linearised, law: Candidate, rest: Rest) -> Floats:
    """Return the white traces (n, k) of a law; uncounted errors are 0."""
    signals = seen_in(law.place)
    traces = np.zeros((len(rest.white), len(law.formulas)))
    traces[rest.rows(signals)] = mixed(law, model.white_traces([law], rest.noise, signals))
    return traces * rest.mask[:, None]


def _alike(traces: Floats, basis: Floats, effects: Sequence[tuple[str, Floats]], share: float = ALIKE) -> str:
    """Return the first effect that reproduces this `share` of a law's traces; empty if there is none.

    The traces of the law are (n, k). Compare after projecting out the orthonormal `basis` (n, p); the columns of the
    effects are orthonormal, too.
    """
    own = _orthonormal(traces - basis @ (basis.T @ traces), traces)
    for name, columns in effects:
        if own.shape[1] and float(np.sum((columns.T @ own) ** 2)) > share * own.shape[1]:
            return name
    return ""


def known_beside(model: Linearised, rest: Rest, selected: Sequence[str], among: Collection[str] | None = None) -> Known:
    """Return the traces of the catalogue's effects beside a model with the residuals `rest` and the effects `selected`.

    With `among`, only effects of these names.
    """
    problem = model.problem
    others = [one for one in problem.effects if one.name not in selected and one.beside in ("", *selected)]
    others = [one for one in others if among is None or one.name in among]
    usual = [one for one in trials(problem.excitation, others) if not one.local]
    tried = [*usual, *filter(None, map(_made_small, usual))]
    sets = [dict(model.values), *({**model.values, **trial.values} for trial in tried)]
    white = problem.made_white([changes_of(one) for one in problem.errors(lanes_of(sets))], rest.noise)
    changes = np.nan_to_num(white[:, 1:]) * rest.mask[:, None]
    free = changes - rest.basis @ (rest.basis.T @ changes)
    columns: list[tuple[str, Floats]] = []
    whole: list[tuple[str, Floats]] = []
    gains: dict[str, float] = {}
    for name in dict.fromkeys(trial.effect for trial in tried):
        for group in _alternatives(tried, name):
            part = _orthonormal(free[:, group], changes[:, group])
            if part.shape[1]:
                columns.append((name, part))
                whole.append((name, _orthonormal(changes[:, group], changes[:, group])))
                gains[name] = max(gains.get(name, 0.0), float(np.sum((part.T @ rest.white) ** 2)))
    return Known(columns, whole, gains, rest)


def _made_small(trial: Trial) -> Trial | None:
    """Return a trial of an effect at a small size; None if it has parameters besides its size."""
    if trial.threshold or not is_rough(CATALOGUE[trial.effect]):
        return None
    origin = {name: trial.origin.get(name, definition(name).neutral or 0.0) for name in trial.values}
    sizes = [name for name in trial.values if definition(name).switches]
    small = {name: origin[name] + SMALL * (trial.values[name] - origin[name]) for name in sizes}
    return replace(trial, values={**trial.values, **small}, portion=SMALL * trial.portion)


def _alternatives(tried: Sequence[Trial], name: str) -> list[list[int]]:
    """Return the trials of an effect, by number, grouped by those that act together.

    Each trial of a limit, and each size, is a group of its own, because their traces do not add up.
    """
    own = [number for number, trial in enumerate(tried) if trial.effect == name]
    if any(tried[number].threshold for number in own):
        return [[number] for number in own]
    portions = dict.fromkeys(tried[number].portion for number in own)
    return [[number for number in own if tried[number].portion == portion] for portion in portions]


def _orthonormal(columns: Floats, before: Floats) -> Floats:
    """Return an orthonormal basis of the columns (n, k) that kept enough of their norm `before` projection."""
    left = np.sum(columns**2, axis=0) > LEAST_OWN * np.maximum(np.sum(before**2, axis=0), 1e-12)
    kept = columns[:, left]
    if not kept.shape[1]:
        return kept
    kept = kept / np.linalg.norm(kept, axis=0)
    u, sizes, _ = np.linalg.svd(kept, full_matrices=False)
    return np.asarray(u[:, sizes > 1e-3 * sizes[0]])
