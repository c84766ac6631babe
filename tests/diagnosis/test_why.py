"""A reader is told why an effect was named or not: on the terminal, and in a folded part of the report."""

import math
import re
from pathlib import Path

import pytest

from cmr.commands.command_line import guarded
from cmr.commands.diagnose import main
from cmr.diagnosis.report import report_of
from cmr.diagnosis.why import NOTHING_DECIDED, WIDTH, why
from cmr.estimation.search.trace import ADDED, INDISTINCT, REMOVED, Decision, with_removed, with_rivals
from tests.commands.test_diagnose_command import Engine
from tests.support.html_page import Page
from tests.support.logs_of_robots import write_logs
from tests.support.made_up_diagnosis import BAD, DIAGNOSIS

TABLE = why(DIAGNOSIS.decisions)


def test_what_statistic_and_threshold_are_stands_above_the_table() -> None:
    above, _, table = TABLE.partition("\n\n")
    assert "likelihood ratio: twice the log-likelihood" in " ".join(above.split())
    assert "compared with the threshold" in " ".join(above.split())
    first, second = table.split("\n")[:2]
    assert [*first.split(), *second.split()] == ["model", "decision", "effects", "statistic", "threshold", "reason"]


def test_each_decision_is_a_line_with_effect_statistic_threshold_and_reason() -> None:
    assert re.search(r"^ +0  added +slope +40\.2 +30\.0\n +It explains most\.$", TABLE, re.MULTILINE)
    assert re.search(r"^ +1  replaced +coulomb_friction +351\.0 +-$", TABLE, re.MULTILINE)
    assert re.search(r"^ +surface_change\n +slope left for it", TABLE, re.MULTILINE)
    assert re.search(r"^ +2  removed +slope +0\.0 +-\n +The others", TABLE, re.MULTILINE)


def test_the_number_that_decided_and_its_limit_are_in_the_reason() -> None:
    row = r"^ +2  removed +gyro_bias +62\.2 +-\n +Its size, 0\.0018 rad/s, is below what matters here, 0\.0030 rad/s\.$"
    assert re.search(row, TABLE, re.MULTILINE)


def test_a_rival_whose_likelihood_ratio_was_not_compared_is_a_row_all_the_same() -> None:
    compared = Decision(0, INDISTINCT, ("back_emf_asymmetry", "motor_gain_asymmetry"), 3.1, 12.0, "Alike.")
    rivals = [("motor_gain_asymmetry", "back_emf_asymmetry"), ("command_delay", "command_jitter")]
    first, last = with_rivals([compared], rivals)
    assert first is compared
    assert (last.action, last.effects) == ("not distinguished", ("command_jitter", "command_delay"))
    assert math.isnan(last.statistic)


def test_the_table_is_as_wide_as_the_rest() -> None:
    assert max(map(len, TABLE.splitlines())) <= WIDTH


def test_where_nothing_was_decided_that_is_said() -> None:
    assert why(BAD.decisions) == NOTHING_DECIDED


def test_what_is_taken_back_after_the_search_belongs_to_its_last_model() -> None:
    begun = (Decision(0, ADDED, ("slope",), 40.0, 30.0, "It explains most."), Decision(3, ADDED, ("a",), 1.0, 0.5, ""))
    last = with_removed(begun, [("slope", 40.0)], "It does harm.")[-1]
    assert (last.step, last.action, last.effects, last.reason) == (3, REMOVED, ("slope",), "It does harm.")
    assert math.isnan(last.threshold)


# The command


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> Engine:
    """The engine that the command asks."""
    stand_in = Engine()
    monkeypatch.setattr("cmr.diagnosis.diagnose.diagnose", stand_in)
    return stand_in


@pytest.mark.usefixtures("engine")
def test_the_command_prints_the_table_only_when_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, out = str(write_logs(tmp_path) / "a.lcm"), str(tmp_path / "out")
    assert guarded(main, [log, "--out", out, "--no-report", "--why"]) == 0
    assert TABLE in capsys.readouterr().out
    assert guarded(main, [log, "--out", out, "--no-report"]) == 0
    assert "threshold" not in capsys.readouterr().out


def test_a_drive_that_is_watched_is_not_searched(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as wrong:
        main(["--live", "--why"])
    assert wrong.value.code == 2
    assert "--why explains the search of logs" in capsys.readouterr().err


# The report


def test_the_report_has_the_table_folded() -> None:
    text = report_of(DIAGNOSIS)
    assert Page(text).texts_of["summary"] == ["5 decisions of the search"]
    folded = text.partition("<details>")[2].partition("</details>")[0]
    for decision in DIAGNOSIS.decisions:
        assert decision.reason in folded
    assert "44.7" in folded
    assert "nan" not in folded


def test_a_report_of_bad_data_has_no_such_part() -> None:
    assert "<details>" not in report_of(BAD)
