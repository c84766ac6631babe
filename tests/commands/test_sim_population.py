"""`cmr-sim` run by hand draws virtual robots from calibrated ones: they differ, and always in the same way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmr.cli.errors import CommandError
from cmr.commands.sim import _scenario, _world
from cmr.commands.sim_options import parse
from cmr.experiments.team.population import drawn_from
from cmr.parameters.file import Value
from cmr.world.loading import Loader
from cmr.world.world import World
from tests.experiments.team.test_population import robot

EPOCH = 1_700_000_000_000_000
STEP = 10_000  # us
SECONDS = 3.0
IDS = (10, 11, 12)
VIRTUAL = [f"{robot_id}=manoeuvre,name=circles,start=0,y={robot_id}" for robot_id in IDS]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Files of three robots; that of robot 3 tells its standard deviations, too."""
    for robot_id, k1 in ((1, 0.050), (2, 0.054)):
        robot(robot_id, 118.0, k1, 0.16).save(tmp_path / f"robot_{robot_id}.yaml")
    third = robot(3, 120.0, 0.058, 0.161)
    replace(third, values={**third.values, "k1": Value(0.058, std=0.001)}).save(tmp_path / "robot_3.yaml")
    return tmp_path


def world_of(folder: Path, *arguments: str) -> World:
    """The world of `cmr-sim` with three robots that all drive the same duties."""
    options = parse(["--parameters", str(folder), "--virtual", *VIRTUAL, *arguments])
    return _world(options, _scenario(options))[0]


def driven(world: World) -> list[float]:
    """How far each robot got along x [m], by ids."""
    for utime in range(EPOCH, EPOCH + round(SECONDS * 1e6), STEP):
        world.advance(utime)
    return [one.state.x for one in sorted(world.robots(), key=lambda one: one.robot_id)]


def test_without_a_population_all_are_clones_and_with_one_each_moves_otherwise(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Loader, "ready", lambda _loader, _parameters: True)  # robots set off at once, not when loaded
    assert np.ptp(driven(world_of(folder, "--parameters-of", "1"))) < 1e-9
    first, again = (driven(world_of(folder, "--population", "1,2,3", "--seed", "7")) for _ in range(2))
    other = driven(world_of(folder, "--population", "1,2,3", "--seed", "8"))
    assert first == again
    assert len({round(x, 4) for x in (*first, *other)}) == 6


@pytest.mark.parametrize("named", [["1,2,3"], ["1", "2", "3"], ["robot_1.yaml", "robot_2.yaml,robot_3.yaml"]])
def test_a_population_is_named_by_ids_or_by_files(
    folder: Path, named: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    paths = [folder / f"robot_{robot_id}.yaml" for robot_id in (1, 2, 3)]
    assert world_of(folder, "--population", *named)._own_parameters == drawn_from(paths, IDS, 0)


def test_one_robot_with_standard_deviations_is_a_population(folder: Path) -> None:
    drawn = world_of(folder, "--population", "3", "--seed", "1")._own_parameters
    assert np.ptp([own.base_width for own in drawn.values()]) == 0.0
    assert len({own.k1 for own in drawn.values()}) == 3


def test_robots_steer_by_the_first_of_the_population_unless_another_is_named(folder: Path) -> None:
    (folder / "elsewhere").mkdir()
    outside = folder / "robot_1.yaml"
    world = world_of(folder / "elsewhere", "--population", str(outside), str(folder / "robot_2.yaml"))
    assert list(world.parameters) == [1]
    assert world.parameters[1].path == outside
    assert list(world_of(folder, "--population", "1,2", "--parameters-of", "3").parameters) == [3]


def test_a_population_takes_the_place_of_a_scenarios(folder: Path) -> None:
    scenario = folder / "two.yaml"
    scenario.write_text(
        "duration: 5\nparameters: robot_1.yaml\npopulation: [robot_1.yaml, robot_2.yaml]\nseed: 4\nrobots:\n"
        "  - {id: 20, kind: virtual}\n"
    )
    files = {robot_id: folder / f"robot_{robot_id}.yaml" for robot_id in (1, 2, 3)}
    own = world_of(folder, "--scenario", str(scenario), "--parameters-of", "1")._own_parameters
    assert own == drawn_from([files[1], files[2]], [20], 4)
    own = world_of(folder, "--scenario", str(scenario), "--population", "2,3", "--seed", "4")._own_parameters
    assert own == drawn_from([files[2], files[3]], [*IDS, 20], 4)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["1"], "no standard deviations. Give files of several calibrated robots, or one that cmr-calibrate wrote"),
        (["1,1"], "are all the same. Give files of different robots"),
        (["1,9"], "robot_9.yaml: cannot be read"),
    ],
)
def test_files_that_make_no_population_are_told_with_what_to_do(folder: Path, arguments: list[str], said: str) -> None:
    with pytest.raises(CommandError, match=f"^--population: .*{said}"):
        world_of(folder, "--population", *arguments)


def test_a_seed_without_a_population_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        world_of(folder, "--seed", "3")
    assert "--seed is that of --population" in capsys.readouterr().err
