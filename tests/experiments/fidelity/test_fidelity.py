"""Fidelity: distances to real teams are told with their chance, and calibration gets no credit not earned."""

import csv
import json
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmr.cli.errors import CommandError
from cmr.commands.fidelity import JOURNAL, main
from cmr.experiments.fidelity.distances import CLOSES, NO_GAP, NOT_SHOWN, WIDENS, Closing, closing, distance
from cmr.experiments.fidelity.findings import Finding, cautions, failures, findings_of, sentences, table
from cmr.experiments.fidelity.preparing import calibrated, moved_by
from cmr.experiments.fidelity.study import PREPARED, SETS, Scores, Study, Task, perform, tasks_of
from cmr.experiments.fidelity.writing import DOCUMENT, FIGURE, RUNS, TABLE, write
from cmr.experiments.team.hidden import HiddenRobot, Laboratory, believed_of
from cmr.experiments.team.metrics import UNITS
from cmr.parameters.file import ParameterFile, Value
from tests.support.bus_bench import our_command
from tests.support.documented_keys import documented
from tests.support.lanes import further
from tests.support.small_teams import BELIEVED, LINE, line_of_three

pytestmark = pytest.mark.slow

SEEDS = 20
PATIENCE = 120.0  # s for processes to start and to end on a busy machine
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
    before = {"uncalibrated": replace(finding.distances["uncalibrated"], value=0.3, p_value=0.124)}
    (sentence,) = sentences([replace(finding, distances={**finding.distances, **before})])
    assert sentence.startswith(
        "time_to_goal, calibrated: no gap shown: without calibration 0.3 s from real teams, no more than expected "
        "by chance (p = 0.12); they differ by "
    )


def test_few_experiments_are_said_to_tell_little() -> None:
    (finding,) = findings(1.0, 0.2)
    few = replace(finding, values={name: values[:4] for name, values in finding.values.items()})
    assert cautions([few])[0].startswith("These are 4 experiments of each kind, in which only large differences show")
    assert cautions([finding]) == []


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


def test_real_teams_and_teams_with_one_real_robot_are_of_different_laboratories_and_preparations_of_the_same() -> None:
    seeds = {name: [task.seed for task in tasks_of(range(SEEDS)) if task.group == name] for name in SETS}
    assert seeds["uncalibrated"] == seeds["calibrated"] == seeds["diagnosed"] == seeds["population"]
    distinct = {*seeds["real A"], *seeds["real B"], *seeds["uncalibrated"]}
    assert len(distinct) == 3 * SEEDS


def test_what_takes_longest_is_done_last_and_only_what_is_chosen() -> None:
    groups = [task.group for task in tasks_of(range(2), ("uncalibrated", "diagnosed", "population"))]
    assert groups[::2] == groups[1::2] == ["real A", "real B", "uncalibrated", "population", "diagnosed"]


def test_laboratories_in_which_a_preparation_failed_are_counted() -> None:
    shares = {"uncalibrated": [1.0, 1.0, 1.0], "calibrated": [1.0, 0.0, 1.0], "population": [2 / 3, 2 / 3, 1.0]}
    scores: dict[str, list[Scores]] = {name: [{PREPARED: one} for one in ones] for name, ones in shares.items()}
    calibrated, population = failures(scores)
    assert calibrated.startswith("calibrated: in 1 of 3 laboratories nothing was found")
    assert population.startswith("population: in 2 of 3 laboratories a robot could not be calibrated")


def test_of_robots_that_could_not_be_calibrated_none_counts() -> None:
    assert moved_by([None], [1, 2], 0) == moved_by([], [1, 2], 0) == moved_by([None, None], [1, 2], 0) == {}
    assert moved_by([BELIEVED], [1, 2], 0) == dict.fromkeys((1, 2), BELIEVED.robot_parameters)
    faster = replace(BELIEVED, values={**BELIEVED.values, "k1": Value(0.05)})
    drawn = moved_by([None, BELIEVED, faster], [1, 2], 0)
    assert drawn.keys() == {1, 2}
    assert drawn[1] != drawn[2]


# From end to end


def study_of(folder: Path, size: float) -> Study:
    """Of three robots, of which the one in the middle is real, beside two virtual ones."""
    return Study(scenario=line_of_three(folder), believed=BELIEVED, real=1, size=size)


def time_to_goal(study: Study, group: str, laboratories: Sequence[int] = (0, 1)) -> float:
    """The mean of some laboratories [s]."""
    return float(np.mean([perform(study, Task(group, number))["time_to_goal"] for number in laboratories]))


@pytest.mark.parametrize("laboratory", [0, *further(1)])
def test_where_robots_are_as_believed_all_teams_are_alike(laboratory: int, tmp_path: Path) -> None:
    study = study_of(tmp_path, 0.0)
    real = time_to_goal(study, "real A", [laboratory])
    for group in ("uncalibrated", "calibrated"):
        assert time_to_goal(study, group, [laboratory]) == pytest.approx(real, abs=0.1)


@pytest.mark.further  # scripts measure it; robots with a velocity controller are calibrated below
def test_where_robots_have_no_other_imperfections_calibration_closes_the_gap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cmr.experiments.team.hidden.USUAL", HiddenRobot())
    monkeypatch.setattr("cmr.experiments.team.hidden.SIGNED_SPREAD", {})
    study = study_of(tmp_path, 1.0)
    real, before, after = (time_to_goal(study, group) for group in ("real A", "uncalibrated", "calibrated"))
    assert abs(after - real) < 0.3 * abs(before - real)


def test_a_robot_that_cannot_be_calibrated_is_taken_to_be_as_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cmr.calibration.calibrator.Calibrator.fit", lambda _calibrator: None)
    study = study_of(tmp_path, 1.0)
    without, failed = (perform(study, Task(group, 0)) for group in ("uncalibrated", "calibrated"))
    assert failed == {**without, PREPARED: 0.0}


@pytest.mark.further  # sweeps go on in the same way
def test_the_command_goes_on_where_it_was_stopped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line_of_three(tmp_path)
    (tmp_path / "three.yaml").write_text(LINE.format(duration=1.0))
    out = tmp_path / "out"
    command = [str(tmp_path / "three.yaml"), "--out", str(out), "--seeds", "4", "--jobs", "1", "--real", "1"]
    assert main([*command, "--prepared", "uncalibrated"]) == 0
    runs = (out / RUNS).read_bytes()
    said = capsys.readouterr().out
    assert "real teams among themselves" in said
    lines = (out / JOURNAL).read_text().splitlines(keepends=True)
    assert len(lines) == 12
    (out / JOURNAL).write_text("".join(lines[:-1]) + lines[-1][:20])  # as when it was killed while it wrote the last
    assert main([*command, "--prepared", "uncalibrated", "--json"]) == 0
    printed = capsys.readouterr()
    assert "11 of 12 experiments are there already" in printed.err
    assert (out / RUNS).read_bytes() == runs
    document = json.loads(printed.out)
    assert [set(document), set(document["findings"][0])] == documented("cmr fidelity")


def children_of(pid: int) -> list[int]:
    """The processes that a process has started and told what to do, without that which tidies up semaphores."""
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    children = [int(child) for path in tasks for child in path.read_text().split()]
    return [child for child in children if b"spawn_main" in of_process(child, "cmdline") and knows_its_work(child)]


def knows_its_work(pid: int) -> bool:
    """Whether a process has begun to load what its work needs: before, it has not been told what that is."""
    return b"numpy" in of_process(pid, "maps")


def of_process(pid: int, name: str) -> bytes:
    return Path(f"/proc/{pid}/{name}").read_bytes()


def test_a_team_that_only_the_live_command_can_end_is_refused(tmp_path: Path) -> None:
    line_of_three(tmp_path)
    text = LINE.format(duration=1.0)
    ending = "ends_when: {metric: minimum_separation, below: 0.1}"
    (tmp_path / "team.yaml").write_text(text.replace("ends_when: waypoints_reached", ending))
    with pytest.raises(CommandError, match="only cmr-run ends a run by minimum_separation"):
        main([str(tmp_path / "team.yaml"), "--out", str(tmp_path / "out")])


@pytest.mark.parametrize("number", [signal.SIGTERM, *further(signal.SIGKILL)])
def test_a_study_that_is_stopped_leaves_nobody_behind(tmp_path: Path, number: signal.Signals) -> None:
    line_of_three(tmp_path)
    (tmp_path / "three.yaml").write_text(LINE.format(duration=600.0))
    command = [our_command("cmr-fidelity"), str(tmp_path / "three.yaml"), "--out", str(tmp_path / "out"), "--jobs", "1"]
    study = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: bool(children_of(study.pid)))
    children = children_of(study.pid)
    study.send_signal(number)
    _, said = study.communicate(timeout=PATIENCE)
    if number == signal.SIGTERM:
        assert study.returncode == 130
        assert said.strip() == "cmr-fidelity: stopped; the same command goes on from here."
    else:  # what a child says that was only just being started is nothing that a killed study could help
        assert study.returncode == -signal.SIGKILL
    wait_until(lambda: not any(Path(f"/proc/{child}").exists() for child in children))


def wait_until(condition: Callable[[], bool]) -> None:
    """Wait until something holds, for as long as a busy machine may take."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_robots_with_a_velocity_controller_hide_another_one_than_is_believed_which_calibration_finds() -> None:
    known = {"wheel_radius": 0.04, "base_width": 0.19, "response_time": 0.15, "top_wheel_speed": 20.0}
    believed = ParameterFile(0, {name: Value(value) for name, value in known.items()})
    laboratory = Laboratory(believed_of(believed), seed=3)
    hidden, found = laboratory.robot(0), calibrated(laboratory, believed, 0, seed=3)
    assert found is not None
    for name in ("response_time", "speed_scale", "base_width"):
        value, truth = found.values[name], getattr(hidden, name)
        assert abs(truth / known.get(name, 1.0) - 1.0) > 0.03, name
        assert value.std is not None
        assert abs(value.value - truth) < 3.0 * value.std, name
