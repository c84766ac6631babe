"""Process noise: virtual robots stray as the real one strayed, each in its own way, and only where they are to."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmr.experiments.team.experiment import ExperimentError, TeamRun, run
from cmr.experiments.team.hidden import Laboratory
from cmr.experiments.team.roles import Roles
from cmr.model.fleet import Fleet
from cmr.model.motion import RobotState
from cmr.parameters.file import ParameterFile, ParameterFileError
from cmr.recordings.signal import Floats
from cmr.world.process_noise import ARC, SETTLING, STEP, WINDOW, ProcessNoise, size_of
from cmr.world.view import TWIN, VIRTUAL, Robots
from tests.support.small_teams import BELIEVED, NUMBERS, line_of_three

COUNT = 400
STRAYED = 0.03  # m


def diagnosed(distance: object = STRAYED) -> ParameterFile:
    """Return the file of a robot whose free runs strayed so far [m]."""
    return replace(BELIEVED, provenance={"method": "diagnosis", "held_out_path_rmse_m": distance})


def robots_of(*ids: int, origin: int = VIRTUAL) -> Robots:
    """Return robots at rest."""
    return Robots(ids, (origin,) * len(ids), RobotState.at_rest(np.zeros(len(ids))))


def disturbances(noise: ProcessNoise, steps: int, *ids: int) -> Floats:
    """Return what becomes of full duty, shape (steps, robots, 2)."""
    robots, full = robots_of(*ids), np.ones((len(ids), 2))
    return np.array([noise.disturbed(full, robots, lambda _: 0) for _ in range(steps)])


def squared_distances(size_in_file: float) -> Floats:
    """Return the mean square by which each robot strays in a free run of the arc [m^2]."""
    noise, fleet = ProcessNoise(seed=7), Fleet(STEP)
    noise.use(0, diagnosed(size_in_file))
    robots, arcs = robots_of(*range(COUNT)), np.tile(ARC, (COUNT, 1))
    fleet.add(RobotState.at_rest(np.zeros(COUNT + 1)), BELIEVED.robot_parameters)
    fleet.command(slice(None), *ARC)
    fleet.advance(round(SETTLING / STEP))
    squares = []
    for _ in range(round(WINDOW / STEP)):
        fleet.command(slice(COUNT), *noise.disturbed(arcs, robots, lambda _: 0).T)
        fleet.advance()
        states = fleet.states()
        squares.append((states.x[:COUNT] - states.x[COUNT]) ** 2 + (states.y[:COUNT] - states.y[COUNT]) ** 2)
    return np.asarray(np.array(squares).mean(axis=0))


def team_run(folder: Path, believed: ParameterFile, *, noise: bool, seed: int = 3) -> TeamRun:
    """Run the line of three, robot 0 real."""
    scenario = replace(line_of_three(folder, duration=3.0), process_noise=noise)
    return run(scenario, Roles(believed, (0,), Laboratory(NUMBERS, 0)), seed)


@pytest.mark.parametrize("distance", [0.01, STRAYED])
def test_robots_stray_as_far_as_the_file_says(distance: float) -> None:
    squares = squared_distances(distance)
    mean = float(squares.mean())
    # Four standard errors of the mean over robots, and 2 x 2 % of the square that the size itself is known to.
    error = 4.0 * float(squares.std()) / COUNT**0.5 + 0.04 * mean
    assert abs(mean - distance**2) < error


def test_each_wheel_of_each_robot_has_noise_of_its_own() -> None:
    noise = ProcessNoise()
    noise.use(0, diagnosed())
    deviations = disturbances(noise, 4000, 1, 2)[::40].reshape(-1, 4) - 1.0  # values 0.4 s apart: nearly independent
    correlations = np.asarray(np.corrcoef(deviations.T))[np.triu_indices(4, 1)]
    assert np.all(np.abs(correlations) < 4.0 / len(deviations) ** 0.5)


def test_the_noise_of_a_robot_does_not_depend_on_who_else_is_there() -> None:
    alone, among_others = ProcessNoise(5), ProcessNoise(5)
    for noise in (alone, among_others):
        noise.use(0, diagnosed())
    disturbances(among_others, 700, 8, 9)  # others were there before
    assert np.array_equal(disturbances(alone, 1200, 3)[:, 0], disturbances(among_others, 1200, 9, 3, 4)[:, 1])


def test_another_seed_is_other_noise() -> None:
    one, other = ProcessNoise(1), ProcessNoise(2)
    for noise in (one, other):
        noise.use(0, diagnosed())
    assert not np.any(disturbances(one, 10, 3) == disturbances(other, 10, 3))


def test_twins_and_robots_at_rest_are_not_disturbed() -> None:
    noise = ProcessNoise()
    noise.use(0, diagnosed())
    assert np.array_equal(noise.disturbed(np.zeros((2, 2)), robots_of(1, 2), lambda _: 0), np.zeros((2, 2)))
    assert np.array_equal(noise.disturbed(np.ones((1, 2)), robots_of(1, origin=TWIN), lambda _: 0), np.ones((1, 2)))


@pytest.mark.parametrize(
    "file", [BELIEVED, diagnosed(None), replace(BELIEVED, provenance={"method": "grid", "held_out_path_rmse_m": 0.1})]
)
def test_a_file_that_does_not_say_how_much_gives_none_and_says_so(file: ParameterFile) -> None:
    noise = ProcessNoise()
    noise.use(0, file)
    assert np.array_equal(disturbances(noise, 3, 1), np.ones((3, 1, 2)))
    assert "robot 0" in noise.problem
    assert "cmr-diagnose" in noise.problem
    with pytest.raises(ParameterFileError):
        size_of(file)
    noise.use(0, diagnosed())
    assert noise.problem == ""


@pytest.mark.slow
def test_an_experiment_with_noise_is_another_one_and_the_same_again(tmp_path: Path) -> None:
    plain, noisy = (team_run(tmp_path, diagnosed(), noise=noise) for noise in (False, True))
    assert not np.array_equal(plain.x[:, 1:], noisy.x[:, 1:])
    assert np.array_equal(team_run(tmp_path, diagnosed(), noise=True).x, noisy.x)
    assert np.array_equal(team_run(tmp_path, BELIEVED, noise=False).x, plain.x)


def test_an_experiment_with_noise_of_unknown_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ExperimentError, match="cmr-diagnose"):
        team_run(tmp_path, BELIEVED, noise=True)
