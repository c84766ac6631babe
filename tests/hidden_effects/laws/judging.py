"""Score what a diagnosis answers about laws against what is to be reached. Pure functions of rows."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from tests.hidden_effects.laws.answers import APPROXIMATION, LAW, NO_LAW, TIE, LawRow
from tests.hidden_effects.laws.kinds import KINDS
from tests.hidden_effects.laws.robots import OF_STATE
from tests.hidden_effects.scoring import Score

SAME = 0.98  # share of a true law that another explains from which it is the same one: constants are estimates


def expected(row: LawRow) -> tuple[str, ...]:
    """Return the kinds of unknown physics hidden in a robot."""
    return tuple(name for name in row.hidden.split() if name in KINDS)


def sayable(row: LawRow) -> bool:
    """Tell whether formulas of the grammar say all unknown physics of a robot."""
    return all(KINDS[name].in_grammar for name in expected(row))


def claimed(row: LawRow) -> bool:
    """Tell whether a formula is called a law."""
    return row.answer == LAW


def exact(row: LawRow) -> bool:
    """Tell whether the laws first in the answer are the true ones, all of them and no other."""
    count = len(row.fits)
    return bool(row.found) and len(row.found) <= max(count, 1) and count > 0 and min(row.fits) >= SAME


def in_set(row: LawRow) -> bool:
    """Tell whether each true law is somewhere in the answer."""
    return bool(row.fits_of_set) and min(row.fits_of_set) >= SAME


def outcome(row: LawRow) -> str:
    """Return in one word what became of a robot with unknown physics."""
    if row.error:
        return "error"
    if exact(row):
        return "exact"
    if claimed(row):
        return "wrong law"
    if row.answer == TIE:
        return "in set" if in_set(row) else "wrong set"
    if row.answer == APPROXIMATION:
        return "approximation"
    if row.verdict == "unexplained" or row.unexplained:
        return "unexplained"
    return "names" if row.names else "silent"


OUTCOMES = (*("exact", "in set", "approximation", "unexplained", "wrong law", "wrong set", "names", "silent", "error"),)
HONEST = ("exact", "in set", "approximation", "unexplained")


def false_law(row: LawRow) -> bool:
    """Tell whether a law is claimed of a robot without unknown physics: as such, or as an approximation of some."""
    return row.answer in (LAW, APPROXIMATION)


def table(rows: Sequence[LawRow]) -> str:
    """Return how robots with each kind fared, a line for each, in percent; and how fast."""
    own = [row for row in rows if row.set_name == "kinds"]
    if not own:
        return ""
    head = f"{'kind':22s} {'robots':>6s} " + " ".join(f"{name[:9]:>9s}" for name in OUTCOMES)
    lines = [head + f" {'place':>6s} {'in set':>6s} {'gain':>6s}"]
    for kind, entry in KINDS.items():
        some = [row for row in own if row.hidden == kind]
        if some:
            counts = [sum(outcome(row) == name for row in some) for name in OUTCOMES]
            cells = " ".join(f"{100.0 * count / len(some):8.0f}%" if count else f"{'.':>9s}" for count in counts)
            places = [row.places_right for row in some if row.found]
            place = f"{100.0 * np.mean(places):5.0f}%" if places else f"{'-':>6s}"
            sets = f"{100.0 * np.mean([in_set(row) for row in some]):5.0f}%"
            mark = " " if entry.in_grammar else "*"
            lines.append(f"{kind + mark:22s} {len(some):6d} {cells} {place} {sets} {_median(some):6.2f}")
    return "\n".join(
        [*lines, "* not in the grammar; gain: path error on held-out data, paper's model over answer, median"]
    )


def failures(rows: Sequence[LawRow]) -> list[str]:
    """Return a line for each robot whose answer is not what it should be: what was hidden, and what was answered."""
    lines = []
    for row in rows:
        expected_words = "; ".join(f"{law.place}: {law.words}" for kind in expected(row) for law in KINDS[kind].laws)
        if row.error or (outcome(row) not in _allowed(row) if expected(row) else false_law(row)):
            removed = f" without entry {row.removed}" if row.removed else ""
            said = " | ".join(row.found) or "-"
            names = ", ".join(row.names) or "-"
            what = f"expected [{expected_words or 'no law'}], got {row.answer} [{said}], names {names}"
            fit = ", fits " + ", ".join(f"{value:.3f}" for value in row.fits) if row.fits else ""
            lines.append(f"{row.set_name}: {row.hidden} seed {row.seed}{removed}: {what}{fit}{_error(row)}")
    return lines


def _allowed(row: LawRow) -> tuple[str, ...]:
    return ("exact", "in set") if sayable(row) else HONEST


def _error(row: LawRow) -> str:
    return f", error {row.error}" if row.error else ""


def scores(rows: Sequence[LawRow]) -> list[Score]:
    """Return the scores of all sets that have rows."""
    result = []
    for name, score in SCORES.items():
        own = [row for row in rows if row.set_name == name]
        if own:
            result += [
                *score(own),
                _share(name, "failed with an error", [row for row in own if row.error], own, most=0.0),
            ]
    return result


def score_kinds(rows: Sequence[LawRow]) -> list[Score]:
    """Score unknown physics alone."""
    inside = [row for row in rows if sayable(row)]
    outside = [row for row in rows if not sayable(row)]
    laws = [row for row in rows if row.found]
    return [
        _share("kinds", "in the grammar: exact first", [row for row in inside if exact(row)], inside, least=0.95),
        _share("kinds", "in the grammar: in the set", [r for r in inside if exact(r) or in_set(r)], inside, least=0.98),
        _share(
            *("kinds", "others: exact, approximation or unexplained"),
            [row for row in outside if outcome(row) in HONEST],
            outside,
            least=0.97,
        ),
        _share(
            "kinds", "a wrong formula called a law", [r for r in rows if outcome(r) == "wrong law"], rows, most=0.02
        ),
        _share("kinds", "silent", [row for row in rows if outcome(row) == "silent"], rows, most=0.0),
        _share("kinds", "right place of laws claimed", [row for row in laws if row.places_right], laws, least=0.97),
        Score("kinds", "processor, median", _cpu(rows), len(rows), unit="s"),
    ]


def score_null(rows: Sequence[LawRow]) -> list[Score]:
    """Score robots with nothing hidden."""
    wrong = [row for row in rows if false_law(row)]
    return [
        _share("null", "a law", wrong, rows, most=0.005),
        Score("null", "processor", _cpu(rows), len(rows), unit="s"),
    ]


def score_catalogue(rows: Sequence[LawRow]) -> list[Score]:
    """Score effects of the catalogue."""
    name = rows[0].set_name
    return [
        _share(name, "a false law", [row for row in rows if false_law(row)], rows, most=0.01),
        _share(name, "right name first", [row for row in rows if row.names[:1] == (row.hidden,)], rows),
    ]


def score_small(rows: Sequence[LawRow]) -> list[Score]:
    """Score effects of the catalogue that are too small to be named: nothing else may be claimed in their place."""
    return [
        _share("small", "a false law", [row for row in rows if false_law(row)], rows, most=0.01),
        _share("small", "another name", [row for row in rows if {*row.names} - {row.hidden}], rows),
    ]


def score_six(rows: Sequence[LawRow]) -> list[Score]:
    """Score robots with six small effects."""
    return [_share("six", "a false law", [row for row in rows if false_law(row)], rows, most=0.01)]


def score_removed(rows: Sequence[LawRow]) -> list[Score]:
    """Score effects whose entry is removed. Whether a law is the removed equation is not judged here."""
    state, others = ([r for r in rows if (r.hidden in OF_STATE) is wanted] for wanted in (True, False))
    return [
        _share("removed", "formulas of the state: an answer", [r for r in state if _answered(r)], state, least=0.85),
        _share("removed", "others: an answer or unexplained", [r for r in others if _answered(r)], others, least=0.85),
        _share("removed", "called a law", [row for row in rows if claimed(row)], rows),
    ]


def _answered(row: LawRow) -> bool:
    return row.answer != NO_LAW or bool(row.names) or row.verdict == "unexplained" or row.unexplained


def score_mixed(rows: Sequence[LawRow]) -> list[Score]:
    """Score an effect and unknown physics together."""
    both = [
        row for row in rows if (exact(row) or in_set(row)) and set(row.hidden.split()) - set(KINDS) <= set(row.names)
    ]
    wrong = [row for row in rows if claimed(row) and not exact(row)]
    return [
        _share("mixed", "both right", both, rows, least=0.85),
        _share("mixed", "a wrong law", wrong, rows, most=0.03),
    ]


SCORES: dict[str, Callable[[Sequence[LawRow]], list[Score]]] = {
    "kinds": score_kinds,
    "null": score_null,
    "catalogue": score_catalogue,
    "small": score_small,
    "six": score_six,
    "removed": score_removed,
    "mixed": score_mixed,
}


def _share(
    name: str,
    quantity: str,
    some: Sequence[LawRow],
    of: Sequence[LawRow],
    *,
    least: float | None = None,
    most: float | None = None,
) -> Score:
    value = len(some) / len(of) if of else math.nan
    if least is not None:
        return Score(name, quantity, value, len(of), f">= {100.0 * least:g} %", value >= least)
    if most is not None:
        return Score(name, quantity, value, len(of), f"<= {100.0 * most:g} %", value <= most)
    return Score(name, quantity, value, len(of))


def _cpu(rows: Sequence[LawRow]) -> float:
    return _middle([row.cpu_seconds for row in rows])


def _median(rows: Sequence[LawRow]) -> float:
    return _middle([row.gain for row in rows])


def _middle(values: Sequence[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.median(known)) if known else math.nan
