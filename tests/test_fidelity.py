"""Fidelity: distances to real teams are told with their chance, and calibration gets no credit not earned."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmr.fidelity.distances import CLOSES, NO_GAP, NOT_SHOWN, WIDENS, Closing, closing, distance
from cmr.fidelity.findings import Finding, findings_of, sentences, table
from cmr.fidelity.study import SETS, Scores, tasks_of
from cmr.fidelity.writing import DOCUMENT, FIGURE, RUNS, TABLE, write
from cmr.team.metrics import UNITS

SEEDS = 20
RANDOM = np.random.default_rng(7)


def around(mean: float, scatter: float = 0.1) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    return mean + scatter * RANDOM.standard_normal(SEEDS)


def findings(uncalibrated: float, calibrated: float) -> list[Finding]:
    """Of a study in which one metric of teams with one real robot is so far off, without and with calibration."""
    means = {"real A": 0.0, "real B": 0.0, "uncalibrated": uncalibrated, "calibrated": calibrated}
    scores: dict[str, list[Scores]] = {
        name: [{**dict.fromkeys(UNITS, float("nan")), "time_to_goal": value} for value in around(20.0 + mean).tolist()]
        for name, mean in means.items()
    }
    return findings_of(scores)


def test_the_distance_is_how_far_values_must_be_moved() -> None:
    values = around(0.0)
    found = distance(values, values + 0.5)
    assert found.value == pytest.approx(0.5)
    assert found.low < 0.5 < found.high
    assert found.p_value < 0.01


def test_two_sets_that_differ_by_chance_are_told_so() -> None:
    assert sum(distance(around(0.0), around(0.0), seed).p_value <= 0.05 for seed in range(10)) <= 3


def test_calibration_that_closes_the_gap_is_told_by_how_much() -> None:
    real = around(0.0)
    closed = closing(real, around(1.0), around(0.2), floor=0.02)
    assert closed.verdict == CLOSES
    assert closed.share == pytest.approx(0.8, abs=0.12)
    assert 0.5 < closed.low < closed.share < closed.high


def test_calibration_that_changes_nothing_is_not_said_to_help() -> None:
    before, change = around(1.0), around(0.0, 0.01)
    after = before + change - change.mean()
    assert closing(around(0.0), before, after, floor=0.02).verdict == NOT_SHOWN


def test_where_there_was_no_gap_nothing_is_closed() -> None:
    (finding,) = findings(0.0, 0.0)
    closed = finding.closings["calibrated"]
    assert closed.verdict == NO_GAP
    assert np.isnan(closed.share)
    assert "no gap to close" in sentences([finding])[0]


def test_calibration_that_takes_teams_away_from_real_ones_is_told() -> None:
    assert closing(around(0.0), around(0.5), around(1.5), floor=0.02).verdict == WIDENS
    assert closing(around(0.0, 0.01), around(0.0, 0.01), around(1.5), floor=0.02).verdict == WIDENS


@pytest.mark.parametrize(
    ("closed", "words"),
    [
        (Closing(CLOSES, 0.8, 0.6, 0.9), "closes the gap by 80 % (60 to 90 %): from "),
        (Closing(WIDENS, -0.3, -0.5, -0.1), "widens the gap by 30 % (10 to 50 %): from "),
        (Closing(NOT_SHOWN, 0.1, -0.2, 0.4), "not shown to close the gap: 10 % (-20 to 40 %) of it, from "),
    ],
)
def test_a_person_is_told_by_how_much_the_gap_changes_or_that_nothing_is_shown(closed: Closing, words: str) -> None:
    (finding,) = findings(1.0, 0.2)
    (sentence,) = sentences([replace(finding, closings={"calibrated": closed})])
    assert sentence.startswith(f"time_to_goal, calibrated: {words}")


def test_metrics_that_mean_nothing_for_a_team_are_left_out() -> None:
    assert [finding.metric for finding in findings(1.0, 0.1)] == ["time_to_goal"]


def test_what_was_found_is_written_as_table_document_and_figure(tmp_path: Path) -> None:
    found = findings(1.0, 0.1)
    scores = {name: [{"time_to_goal": v} for v in values.tolist()] for name, values in found[0].values.items()}
    write(tmp_path, scores, found, {"seeds": SEEDS})
    document = json.loads((tmp_path / DOCUMENT).read_text())
    compared = [row["compared"] for row in document["findings"]]
    assert compared == ["real teams among themselves", "uncalibrated", "calibrated"]
    assert document["findings"][2]["verdict"] == CLOSES
    with (tmp_path / TABLE).open() as stream:
        assert [row["compared"] for row in csv.DictReader(stream)] == compared
    with (tmp_path / RUNS).open() as stream:
        assert len(list(csv.DictReader(stream))) == 4 * SEEDS
    assert (tmp_path / FIGURE).read_bytes().startswith(b"\x89PNG")
    assert len(table(found).splitlines()) == 1 + len(compared)


def test_no_two_laboratories_of_a_study_are_the_same() -> None:
    seeds = [task.seed for task in tasks_of(range(SEEDS))]
    assert len(set(seeds)) == len(seeds) == len(SETS) * SEEDS
