"""What an investigation reports while it drives: at each change and each second, and never what is half decided."""

import json
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cmr.investigation import reporting
from cmr.investigation.driving import AtOnce, Driving, Place
from cmr.investigation.movements import PERIOD, Movement
from cmr.investigation.reporting import Reports
from cmr.msg import investigation_status_t as status_t

FORWARD = Movement("forward", np.full((100, 2), 0.4))
WAITS = "later data must confirm it"
ODDS = {"": 0.25, "gyro_bias": 0.7493, "wheel_wobble": 0.0007}
PATH = np.arange(24.0).reshape(6, 2, 2)  # places, members, x and y
TICK = round(PERIOD * 1e6)  # us


class Investigating:
    """An investigation that drives forward three times; while it decides, nobody may ask it for names."""

    floor = SimpleNamespace(margin=0.1, room=lambda _x, _y: np.array(1.0))
    longest = 60.0

    def __init__(self) -> None:
        self.decisions, self.waited = 0, 0.0

    @property
    def named(self) -> tuple[str, ...]:
        """Fail: it is being decided which they are."""
        raise KeyError("what was just found is not in the judgement yet")

    def opening(self, *_place: float) -> tuple[Movement, str]:
        """Return a short opening."""
        return Movement("opening", np.zeros((10, 2))), ""

    def decide(self, *_asked: object) -> SimpleNamespace:
        """Choose the same again."""
        self.decisions += 1
        choice = SimpleNamespace(movement=FORWARD, path=PATH, parted=("gyro_bias", ""))
        judgement = SimpleNamespace(probabilities=ODDS)
        over = self.decisions > 3
        told = {"judgement": judgement, "named": ("deadband",), "choice": choice, "reckoned": None, "held_back": WAITS}
        return SimpleNamespace(**told, finished=over, sentence="")


@pytest.fixture
def reports(monkeypatch: pytest.MonkeyPatch) -> list[status_t]:
    """All reports of a drive."""
    monkeypatch.setattr(reporting, "excluded", lambda _driving: ["a", "b"])
    monkeypatch.setattr(reporting, "out_of_reach", lambda _driving: {"c": "because"})
    driving = Driving(cast(Any, Investigating()), lambda: cast(Any, None), AtOnce())
    told = Reports(driving, 4)
    said: list[status_t] = []
    for tick in range(500):
        driving.command(tick * TICK, Place(0.0, 0.0, 0.0, 0.0))
        said += told.due(tick * TICK)
    return said


def test_each_movement_is_reported_when_it_begins_and_each_second_something_is(reports: list[status_t]) -> None:
    """The opening with what fills the first choice, three movements, and the end, which stays."""
    states = [report.state for report in reports]
    assert states == sorted(states)
    assert states.count(status_t.DRIVING) == 3 * 2
    assert np.max(np.diff([report.utime for report in reports])) <= 1_000_000
    assert reports[-1].state == status_t.DONE
    assert {report.robot_id for report in reports} == {4}


def test_a_report_has_what_is_left_and_why_the_movement_is_driven(reports: list[status_t]) -> None:
    """The likeliest first, without those of less than one in a thousand; paths member after member, thinned."""
    report = next(one for one in reports if one.state == status_t.DRIVING)
    assert list(json.loads(report.explanations).items()) == [("gyro_bias", 0.7493), ("nothing more", 0.25)]
    assert (json.loads(report.named), report.excluded, report.not_shown) == (["deadband"], 2, 1)
    assert (report.movement, report.first, report.second) == ("forward", "gyro_bias", "nothing more")
    assert report.message == f"gyro_bias is the likeliest further effect (75 %), but not named: {WAITS}."
    assert (report.members, report.n) == (2, 6)
    assert list(report.x) == PATH[::2, 0, 0].tolist() + PATH[::2, 1, 0].tolist()
    assert list(report.y) == PATH[::2, 0, 1].tolist() + PATH[::2, 1, 1].tolist()


def test_without_a_decision_there_is_nothing_left_and_no_path(reports: list[status_t]) -> None:
    """In the opening nothing was looked at; at the end nothing is driven."""
    for report in (reports[0], reports[-1]):
        assert (report.members, report.n, report.first) == (0, 0, "")
    assert json.loads(reports[0].explanations) == {}
    assert reports[-1].movement == ""
