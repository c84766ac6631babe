"""Name certain effects one by one, and withdraw those that a better set of effects does not contain."""

from collections.abc import Sequence
from dataclasses import dataclass

from cmr.estimation.gains import COARSE
from cmr.estimation.search.chance import TICKS, tick_of
from cmr.investigation.choosing import SAME
from cmr.investigation.evidence import Beliefs
from cmr.investigation.exchanging import evidence_beside, revision
from cmr.investigation.judging import NAMED, NOTHING, Explanation, Judgement, ahead_since, judge, own_parameters
from cmr.model.catalogue import CATALOGUE

# Evidence required from the data after the first suspicion alone, as a share of the margin then, within bounds.
CONFIRMED_SHARE, CONFIRMED = 0.1, (4.0, NAMED)
LOCAL = 8.0  # drop by which effects at a place or a time must lose by the data, not by their number of parameters
TOO_SMALL = "too small to matter"
NOT_APART = "{rival} explains nearly as much"
NOT_CONFIRMED = "later data must confirm it"


@dataclass
class _Suspect:
    """An effect that first reached the odds with this margin, by the data up to `moment`."""

    name: str
    margin: float
    moment: float


class Naming:
    """The effects found as data come in.

    `found` are the effects found so far; those `named` are still valid and large enough to matter. `judgement` is the
    newest one. `unconfirmed` is the evidence that new data must still add for a suspect, by name.
    """

    def __init__(self) -> None:
        self.found: tuple[str, ...] = ()
        self.judgement: Judgement | None = None
        self.unconfirmed: dict[str, float] = {}
        self._suspect: _Suspect | None = None
        self._doubted: frozenset[str] = frozenset()
        self._wanted: frozenset[str] | None = None  # the set of effects that was better at the last decision

    @property
    def named(self) -> tuple[str, ...]:
        """The effects found that still reach the odds of a name and are large enough to matter."""
        return tuple(name for name in self.found if name not in self._doubted and self._matters(name))

    @property
    def doubted(self) -> tuple[str, ...]:
        """The effects found that no longer reach the odds of a name."""
        return tuple(name for name in self.found if name in self._doubted)

    @property
    def held_back(self) -> str:
        """Why the likeliest explanation is not named, whatever its odds; empty if nothing more is likelier."""
        judgement = self.judgement
        if judgement is None or judgement.best.name == NOTHING:
            return ""
        best = judgement.best
        if not judgement.is_large(best.name, best.values):
            return TOO_SMALL
        close = _close_local(judgement)
        if close is not None:
            return NOT_APART.format(rival=close.name)
        return NOT_CONFIRMED if margin(judgement) >= NAMED else ""

    def _matters(self, name: str) -> bool:
        if name == TICKS or self.judgement is None:
            return True
        return self.judgement.is_large(name, self.judgement.base.values)

    def judged(self, problem: Beliefs) -> Judgement:
        """Return the judgement of all data, after adding the effects that are certain enough."""
        before = self.judgement
        usable = {*problem.own, *own_parameters(_fitted(self.found))}
        last = before.base.values if before else {}
        start = {**problem.excitation.parameters, **{name: last[name] for name in usable if name in last}}
        judgement = judge(problem, _fitted(self.found), start, before)
        if tick_of(problem) > COARSE and TICKS not in self.found:
            self.found = (*self.found, TICKS)
        while (name := self._confirmed(judgement)) != NOTHING:
            self.found = (*self.found, name)
            self._suspect = None
            judgement = judge(problem, _fitted(self.found), judgement.best.values)
        self.judgement = self._revised(judgement)
        return self.judgement

    def _revised(self, judgement: Judgement) -> Judgement:
        """Return the judgement beside another set of effects, if that was clearly better twice in a row.

        An effect that a better set lacks, and that the data do not need, is doubted.
        """
        self._doubted = frozenset()
        if not judgement.named:
            self._wanted = None
            return judgement
        beside = evidence_beside(judgement)
        self._doubted = frozenset(name for name, evidence in beside.items() if evidence < NAMED)
        found = revision(judgement, beside)
        before, self._wanted = self._wanted, frozenset(found.names) if found else None
        if found is None:
            return judgement
        gone = {name for name in judgement.named if name not in found.names}
        self._doubted |= gone
        coming = [name for name in found.names if name not in judgement.named]
        if self._wanted != before or (coming and found.lead < NAMED):
            return judgement
        self.found = (*(name for name in self.found if name not in gone), *coming)
        self._wanted, self._suspect, self.unconfirmed = None, None, {}
        return judge(judgement.problem, _fitted(self.found), found.values)

    def _confirmed(self, judgement: Judgement) -> str:
        """Return the effect that is certain now; NOTHING if none is."""
        best, sure = judgement.best, margin(judgement)
        self.unconfirmed = {}
        if best.name == NOTHING or sure < NAMED:
            self._suspect = None
            return NOTHING
        if self._suspect is None or self._suspect.name != best.name:
            self._suspect = _Suspect(best.name, sure, judgement.problem.last)
        # One lost packet looks like backlash until the robot has driven on.
        nothing, rival = judgement.of(NOTHING), _rivals(judgement)[0]
        assert nothing is not None
        least, most = CONFIRMED
        needed = min(max(CONFIRMED_SHARE * self._suspect.margin, least), most)
        allowed = max(CONFIRMED_SHARE * sure, least)  # a rival far behind may fit the newest data a little better
        since = self._suspect.moment
        missing = needed - ahead_since(judgement, nothing, since)
        if missing <= 0.0 and ahead_since(judgement, rival, since) >= -allowed:
            return best.name
        self.unconfirmed = {best.name: max(missing, least)}
        return NOTHING


def margin(judgement: Judgement) -> float:
    """Return the evidence by which the likeliest explanation leads all that are not mathematically the same.

    It is at most 0 while an effect of a place or a time, with its many parameters, explains the data nearly as well.
    """
    ahead = min((judgement.best.evidence - one.evidence for one in _rivals(judgement)), default=0.0)
    return min(ahead, 0.0) if _close_local(judgement) is not None else ahead


def _close_local(judgement: Judgement) -> Explanation | None:
    """Return an effect of a place or a time that explains the data nearly as well as the likeliest, if any."""
    close = (
        one for one in _rivals(judgement) if _is_local(one) and one.fitted and judgement.best.drop - one.drop < LOCAL
    )
    return next(close, None)


def _rivals(judgement: Judgement) -> list[Explanation]:
    """Return the explanations beside the likeliest that are not mathematically the same, the nearest first."""
    return [one for one in judgement.explanations[1:] if frozenset((judgement.best.name, one.name)) not in SAME]


def _is_local(one: Explanation) -> bool:
    return bool(one.name and CATALOGUE[one.name].locality)


def _fitted(named: Sequence[str]) -> tuple[str, ...]:
    """Return the named effects that are part of fits."""
    return tuple(name for name in named if name != TICKS)
