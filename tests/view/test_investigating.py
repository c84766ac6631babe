"""The page shows an investigation: bars of what is left, what is driven and why, and the predicted paths."""

import json
import math
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cmr.bus.messages import make
from cmr.bus.streams import INVESTIGATION_STATUS
from cmr.msg import investigation_status_t
from cmr.report.likelihood import length
from cmr.view.data.state import SILENT_FOR, ViewState
from cmr.view.investigating import MOST_BARS, Bar, bars_of, card, investigated
from cmr.view.picture import LILAC, PURPLE, picture_of
from tests.support.small_log import FIELDS
from tests.support.view_states import NOW, showing, three

SECOND = 1_000_000
EARLY = {"nothing more": 0.6, "gyro_bias": 0.3, "wheel_wobble": 0.1}
LATE = {"gyro_bias": 0.995, "nothing more": 0.005}


def reported(state: ViewState, utime: int, robot_id: int = 0, /, **fields: Any) -> ViewState:
    """Return the state after a report of this moment."""
    of = {**FIELDS["INVESTIGATION_STATUS"], **fields}
    message = make(investigation_status_t, utime=utime, robot_id=robot_id, **of)
    state.handle(utime, INVESTIGATION_STATUS.channel(robot_id), message)
    state.advance(utime)
    return state


def two_decisions() -> ViewState:
    """Return a state in which three explanations became two, and the second decision was said again."""
    state = reported(showing(three(NOW)), NOW, explanations=json.dumps(EARLY))
    for k in (1, 2):
        reported(state, NOW + k * SECOND, explanations=json.dumps(LATE), named='["gyro_bias"]')
    return state


def test_bars_shrink_from_what_was_likely_one_decision_before() -> None:
    """An excluded explanation shrinks to zero; a repeated decision does not hide the previous one."""
    bars = bars_of(investigated(two_decisions(), 0))
    assert bars == [Bar("gyro_bias", 0.995, 0.3), Bar("nothing more", 0.005, 0.6), Bar("wheel_wobble", 0.0, 0.1)]
    shown = card(investigated(two_decisions(), 0))
    assert "--from:67%;--to:0%" in shown  # wheel_wobble
    assert [shown.find(words) > 0 for words in ("199 : 1", "1 : 200", "gone", "Named: gyro_bias")] == [True] * 4


def test_what_is_driven_and_why_is_said_in_the_states_words() -> None:
    """In each state there is a sentence; what interrupted the drive is added to it."""
    state = showing(three(NOW))
    driving = card(investigated(reported(state, NOW, first="a_cause", second="nothing more"), 0))
    assert "Drives: rest" in driving
    assert "Why: to separate a_cause from nothing more" in driving
    for number in range(5):
        words = card(investigated(reported(showing(three(NOW)), NOW, state=number, message="It stands."), 0))
        assert words.count("<p>") == (4 if number == investigation_status_t.DRIVING else 3)
        assert "It stands." in words


def test_before_the_first_decision_nothing_is_counted() -> None:
    """In the opening there is nothing that could be left."""
    words = card(investigated(reported(showing(three(NOW)), NOW, state=0, explanations="{}", excluded=0), 0))
    assert " left" not in words
    assert "Opening" in words


def test_the_card_is_of_the_chosen_robot_or_of_one_that_is_investigated_and_is_gone_after_a_silence() -> None:
    """Where no robot is investigated there is none."""
    state = reported(reported(showing(three(NOW)), NOW, 5), NOW, 7)
    for chosen, shown in ((5, "robot 5"), (7, "robot 7"), (0, "robot 5")):
        assert f"Investigation of {shown}" in card(investigated(state, chosen))
    state.advance(NOW + SILENT_FOR + SECOND)
    assert card(investigated(state, 5)) == ""


def test_another_drive_begins_anew() -> None:
    """Bars do not shrink from those of an investigation that is over."""
    state = reported(showing(three(NOW)), NOW, driven=30.0, explanations=json.dumps(EARLY))
    reported(state, NOW + SECOND, driven=3.0, explanations=json.dumps(LATE))
    assert len(state.investigations[0]) == 1


def test_all_predicted_paths_are_drawn_the_likeliest_last() -> None:
    """Two members of three places each are two times two lines; a robot that is not there has none."""
    paths = {"members": 2, "x": [0.0, 0.1, 0.2, 0.0, 0.1, 0.3], "y": [0.0] * 6}
    state = reported(showing(three(NOW)), NOW, **paths)
    drawn = picture_of(state).predicted
    assert drawn.ends.shape == (4, 2, 3)
    assert drawn.colour[:, 0].tolist() == [[*LILAC]] * 2 + [[*PURPLE]] * 2
    assert np.allclose(drawn.ends[-1, 1, :2], (0.2, 0.0))
    assert not len(picture_of(reported(showing(three(NOW)), NOW, 99, **paths)).predicted.ends)
    for wrong in ({"members": 4}, {"members": 0}, {"members": -1}, {"x": [math.nan] * 6}):
        assert not len(picture_of(reported(showing(three(NOW)), NOW, **{**paths, **wrong})).predicted.ends)


@given(text=st.one_of(st.text(), st.dictionaries(st.text(), st.floats() | st.text() | st.none()).map(json.dumps)))
def test_whatever_a_stranger_sends_the_card_is_drawn(text: str) -> None:
    """Texts of strangers are no markup, and no bar is longer than its track."""
    state = reported(showing(three(NOW)), NOW, explanations=text, named=text, movement=text, message="<img>")
    history = investigated(state, 0)
    assert "<img>" not in card(history)
    bars = bars_of(history)
    assert len(bars) <= MOST_BARS
    assert all(0.0 <= length(one.now) <= 1.0 for one in bars)
