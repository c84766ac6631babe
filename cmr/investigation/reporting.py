"""The remaining explanations and the next movement, as a message: INVESTIGATION_STATUS_N, which pages show."""

import json
from collections.abc import Iterator

import numpy as np

from cmr.bus.messages import make
from cmr.investigation.driving import Driving
from cmr.investigation.engine import Decision
from cmr.investigation.judging import ODDS
from cmr.investigation.telling import NOTHING_MORE, excluded, out_of_reach, suspicion
from cmr.msg import investigation_status_t as status_t
from cmr.recordings.signal import Floats

PERIOD = 1_000_000  # us between two reports without news
EVERY = 2  # every so many places of predicted paths, 0.1 s apart, are reported
NO_PATH: Floats = np.empty((0, 1, 2))


class Reports:
    """The reports of an investigation: one at the start of each movement, and one each second."""

    def __init__(self, driving: Driving, robot_id: int) -> None:
        self._driving, self._robot_id = driving, robot_id
        self._said: tuple[object, ...] = ()
        self._due = 0
        self._counted: Decision | None = None
        self._counts = 0, 0

    def due(self, utime: int) -> Iterator[status_t]:
        """Yield the report of this moment [us] if one is due."""
        driving = self._driving
        says = _state(driving), driving.movement, driving.decision, driving.note
        if utime >= self._due or any(now is not before for now, before in zip(says, self._said, strict=False)):
            self._said, self._due = says, utime + PERIOD
            yield self._report(utime)

    def _report(self, utime: int) -> status_t:
        driving, decision = self._driving, self._driving.decision
        state = _state(driving)
        choice = decision.choice if decision is not None and state == status_t.DRIVING else None
        path = choice.path[::EVERY] if choice is not None and choice.path is not None else NO_PATH
        first, second = (name or NOTHING_MORE for name in choice.parted) if choice is not None else ("", "")
        excluded_now, hidden = self._counted_of(decision)
        return make(
            status_t,
            utime=utime,
            robot_id=self._robot_id,
            state=state,
            driven=driving.drove,
            longest=driving.investigation.longest,
            explanations=json.dumps(_left(decision)),
            named=json.dumps(decision.named if decision is not None else ()),
            excluded=excluded_now,
            not_shown=hidden,
            movement=driving.movement.name if driving.movement is not None else "",
            first=first,
            second=second,
            members=path.shape[1] if len(path) else 0,
            x=path[..., 0].T.ravel().tolist(),
            y=path[..., 1].T.ravel().tolist(),
            message=driving.problem or driving.note or suspicion(decision),
        )

    def _counted_of(self, decision: Decision | None) -> tuple[int, int]:
        """Return the numbers of excluded effects, and of those that would not have shown; counted once per decision."""
        if decision is not self._counted:
            self._counted = decision
            self._counts = len(excluded(self._driving)), len(out_of_reach(self._driving))
        return self._counts


def _state(driving: Driving) -> int:
    if driving.finished:
        return status_t.FAILED if driving.problem else status_t.DONE
    if driving.movement is None:
        return status_t.PLANNING
    is_chosen = driving.decision is not None and driving.movement is driving.decision.choice.movement
    return status_t.DRIVING if is_chosen else status_t.OPENING


def _left(decision: Decision | None) -> dict[str, float]:
    """Return the probability of each remaining explanation, by name, the likeliest first."""
    if decision is None:
        return {}
    likely = {name: share for name, share in decision.judgement.probabilities.items() if share > 1.0 / ODDS}
    return {name or NOTHING_MORE: round(likely[name], 4) for name in sorted(likely, key=lambda one: -likely[one])}
