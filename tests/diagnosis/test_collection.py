"""Laws of many robots: the same law is compared, one entry is proposed with its spread, and kept under a name."""

import json
import pickle
import subprocess
import sys
from collections.abc import Iterator, Mapping
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from cmr.cli.errors import CommandError
from cmr.diagnosis.collection import families, family_of, proposal, sightings
from cmr.diagnosis.collection_command import main
from cmr.model.catalogue import LAWS, learn, unlearn
from cmr.model.laws import Law
from cmr.parameters.file import ParameterFile, Value, load
from cmr.parameters.laws import read_law

TURN_COST = Law("law_yaw_rate_w_abs_v", "yaw_rate", ("w * abs(v)",))
PAPER = {"wheel_radius": 0.04, "k2_over_k3": 60.0, "k1": 0.04, "base_width": 0.2}
DAY = datetime(2026, 5, 1, tzinfo=timezone.utc)


@pytest.fixture(autouse=True)
def _catalogue_as_before() -> Iterator[None]:
    known = set(LAWS)
    yield
    for name in set(LAWS) - known:
        unlearn(name)


def save(
    path: Path, robot_id: int, value: float, law: Law = TURN_COST, day: int = 0, paper: Mapping[str, float] = PAPER
) -> None:
    """Write the parameters of a robot with a law, as a diagnosis does; this process forgets the law."""
    learn(law)
    values = {**{name: Value(one) for name, one in paper.items()}, law.name: Value(value, 0.002)}
    file = ParameterFile(robot_id, values, (law.name,), written=DAY + timedelta(days=day))
    path.parent.mkdir(parents=True, exist_ok=True)
    file.save(path)
    unlearn(law.name)


def test_the_same_law_is_found_whatever_it_is_called(tmp_path: Path) -> None:
    save(tmp_path / "a" / "robot_0.yaml", 0, -0.06)
    save(tmp_path / "b" / "robot_1.yaml", 1, -0.07, Law("law_turn_cost", "yaw_rate", ("w * abs(v)",)))
    save(tmp_path / "c" / "robot_2.yaml", 2, 0.01, Law("law_turn_cost", "gyro", ("w",)))  # another of the same name

    found = families(sightings([tmp_path]))

    assert [[one.robot_id for one in family] for family in found] == [[2], [0, 1]]
    assert not LAWS


def test_the_spread_of_a_coefficient_is_what_its_own_uncertainty_does_not_explain(tmp_path: Path) -> None:
    draw = np.random.default_rng(1)
    for robot in range(40):
        save(
            tmp_path / f"robot_{robot}.yaml",
            robot,
            -0.06 + 0.01 * draw.standard_normal() + 0.002 * draw.standard_normal(),
        )

    family = family_of(sightings([tmp_path]), 0)

    # The standard error of a standard deviation of 40 is 0.01 / sqrt(78) = 0.0011, that of their mean 0.0016.
    assert family.spread == pytest.approx(0.01, abs=3 * 0.0011)
    assert family.mean == pytest.approx(-0.06, abs=3 * 0.0016)
    assert family.between < 1e-6
    assert np.isnan(family.within)


def test_days_of_one_robot_are_told_from_robots(tmp_path: Path) -> None:
    for robot in range(4):
        for day in range(3):
            save(tmp_path / f"{day}" / f"robot_{robot}.yaml", robot, -0.06 - 0.01 * robot + 0.001 * (day - 1), day=day)

    family = family_of(sightings([tmp_path]), 0)

    assert family.between < 1e-6
    assert family.within > 0.5


def test_a_coefficient_that_goes_with_the_base_width_moves_with_the_floor(tmp_path: Path) -> None:
    for day in range(6):
        paper = {**PAPER, "base_width": 0.2 + 0.01 * day}
        save(tmp_path / f"{day}" / "robot_0.yaml", 0, -0.06 - 0.01 * day, day=day, paper=paper)

    family = family_of(sightings([tmp_path]), 0)

    assert set(family.goes_with) == {"base_width"}
    assert family.goes_with["base_width"] < -0.99


def test_one_entry_is_kept_renamed_and_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for robot, value in enumerate((-0.055, -0.06, -0.065)):
        save(tmp_path / "in" / f"{robot}" / f"robot_{robot}.yaml", robot, value)

    out = tmp_path / "laws"
    words = ["--name", "law_turn_cost", "--description", "Speed costs turning."]
    assert main([str(tmp_path / "in"), "--law", TURN_COST.name, "--out", str(out), *words]) == 0

    entry = read_law(out / "law_turn_cost.yaml")
    assert entry.law.description == "Speed costs turning."
    assert entry.coefficients["law_turn_cost"].value == pytest.approx(-0.06, abs=1e-6)
    assert len(entry.sources) == 3
    assert load(out / "robot_2.yaml").robot_parameters.effects == {"law_turn_cost": -0.065}
    assert proposal(sightings([out]), "law_again").law.description == "Speed costs turning."
    printed = capsys.readouterr().out
    assert "Speed costs turning: w = w_wheels (1 - 0.06 s/m abs(v))" in printed
    assert "One entry for 3 robots and 3 files" in printed


def test_programs_get_the_same_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(tmp_path / "robot_0.yaml", 0, -0.06)

    main([str(tmp_path), "--json"])

    [law] = json.loads(capsys.readouterr().out)["laws"]
    assert law["coefficients"][TURN_COST.name]["mean"] == pytest.approx(-0.06)
    assert law["found"][0]["robot_id"] == 0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["missing"], "no such file"),
        (
            ["robot_0.yaml", "--law", "law_other"],
            "no parameter file has the law law_other; found: law_yaw_rate_w_abs_v",
        ),
        (["robot_0.yaml", "--name", "law_a"], "are for one law that is kept"),
        (["robot_0.yaml", "--out", "laws", "--name", "turn_cost"], "must be law_ and words"),
        (["bad.yaml"], "bad.yaml"),
    ],
)
def test_what_cannot_be_done_says_why(
    arguments: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    save(tmp_path / "robot_0.yaml", 0, -0.06)
    (tmp_path / "bad.yaml").write_text("schema: 7\n")

    with pytest.raises(CommandError, match=says):
        main(arguments)


def test_a_process_that_gets_parameters_by_pickle_knows_their_laws(tmp_path: Path) -> None:
    save(tmp_path / "robot_0.yaml", 0, -0.06)
    (tmp_path / "pickled").write_bytes(pickle.dumps(load(tmp_path / "robot_0.yaml")))
    code = (
        "import pickle, sys; file = pickle.loads(open(sys.argv[1], 'rb').read()); "
        "from cmr.model.catalogue import effects_on; print(effects_on(file.robot_parameters.effects)[0].name)"
    )

    result = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "pickled")], capture_output=True, text=True, check=True
    )

    assert result.stdout.strip() == TURN_COST.name
