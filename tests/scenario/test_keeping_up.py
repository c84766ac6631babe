"""A run on a computer that was too busy is marked as unreliable, beside each figure, and the computer is blamed."""

from pathlib import Path

import pytest

from cmr.scenario.keeping_up import Pace, in_words, is_too_late, what_was_too_slow
from cmr.scenario.page import run_page
from cmr.scenario.report import document_of, metrics_in_words
from tests.scenario.test_run_elsewhere import all_statuses, live_run

STEADY = [Pace("sim", 100.0, 3), Pace("driver 0", 100.0, 0)]


def test_a_computer_that_keeps_up_is_not_blamed() -> None:
    assert what_was_too_slow(STEADY, 60.0, 49.0, 50.0) == []
    assert in_words([]) == ""


def test_late_cycles_are_named_with_their_process() -> None:
    late = Pace("pilot 0", 45.0, 300)
    assert what_was_too_slow([*STEADY, late], 60.0, 49.0, 50.0) == ["pilot 0 was late in 11 % of its cycles"]
    assert is_too_late(late, 60.0)
    assert not is_too_late(STEADY[0], 60.0)


def test_a_process_that_hardly_ran_is_late_in_all_of_its_cycles_at_most() -> None:
    assert what_was_too_slow([Pace("sim", 0.5, 5000)], 10.0, 50.0, 50.0) == ["sim was late in 100 % of its cycles"]


def test_a_world_below_its_rate_is_named_with_both_rates() -> None:
    [found] = what_was_too_slow(STEADY, 60.0, 38.2, 50.0)
    assert found == "the world was published at 38 Hz instead of 50 Hz"


def test_a_run_that_hardly_began_says_nothing_about_the_computer() -> None:
    assert what_was_too_slow([Pace("sim", 0.0, 50)], 0.2, 0.0, 50.0) == []


def test_each_figure_that_is_spoilt_is_marked_and_the_computer_blamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = "sim was late in 14 % of its cycles"
    monkeypatch.setattr("cmr.scenario.report.what_was_too_slow", lambda *_measured: [late])
    run, outcome, _ = live_run(tmp_path, all_statuses(), all_statuses())
    document = document_of(run, outcome, 0.0)
    document["metrics"] = {"formation_error": 0.2, "distance_driven": 5.0}
    assert metrics_in_words(document).count(" (unreliable)") == 2
    page = run_page(document)
    assert f"{late}. The computer was too busy; robots and cables are not the cause." in page
    assert page.count(">unreliable</span>") == 3  # two metrics, and how near robots came
    document["unreliable"] = ""
    assert "nreliable</" not in run_page(document)
