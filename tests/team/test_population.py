"""Virtual robots drawn from real ones: as many differ, as much, and always the same."""

from pathlib import Path

import numpy as np
import pytest

from cmr.model.catalogue import MODELLED, definition
from cmr.parameters.file import ParameterFile, Value
from cmr.team.population import PopulationError, drawn_from, population_of

DRAWS = 2000


def robot(robot_id: int, k2: float, k1: float, base: float, **effects: float) -> ParameterFile:
    values = {"wheel_radius": 0.04, "k2_over_k3": k2, "k1": k1, "base_width": base, **effects}
    return ParameterFile(robot_id, {name: Value(v) for name, v in values.items()}, tuple(effects))


K2, K1 = (95.0, 105.0, 115.0, 120.0, 130.0, 140.0), (0.060, 0.057, 0.054, 0.052, 0.049, 0.047)
BASE = (0.160, 0.161, 0.159, 0.163, 0.158, 0.162)
SIX = [robot(i, k2, k1, base) for i, (k2, k1, base) in enumerate(zip(K2, K1, BASE, strict=True))]


def test_drawn_robots_have_the_mean_and_the_scatter_of_the_calibrated_ones() -> None:
    population = population_of(SIX)
    drawn = np.log([list(population.draw(1, robot_id)) for robot_id in range(DRAWS)])
    given = np.log([list(file.robot_parameters) for file in SIX])
    scatter = given.std(axis=0, ddof=1)
    assert np.all(np.abs(drawn.mean(axis=0) - given.mean(axis=0)) <= 4.0 * scatter / np.sqrt(DRAWS) + 1e-12)
    np.testing.assert_allclose(drawn.std(axis=0)[1:], scatter[1:], rtol=0.06)


def test_what_went_together_in_the_calibrated_robots_goes_together_in_drawn_ones_only_weaker() -> None:
    population = population_of(SIX)
    drawn = np.log([list(population.draw(1, robot_id)) for robot_id in range(DRAWS)])
    given = np.log([list(file.robot_parameters) for file in SIX])
    seen, kept = np.corrcoef(given[:, 1:].T)[0, 1], np.corrcoef(drawn[:, 1:].T)[0, 1]
    assert seen < -0.99
    assert seen + 0.05 < kept < -0.3


def test_two_robots_say_nothing_about_correlations() -> None:
    population = population_of(SIX[:2])
    drawn = np.log([list(population.draw(1, robot_id)) for robot_id in range(DRAWS)])
    assert np.all(np.abs(np.corrcoef(drawn[:, 1:].T) - np.eye(3)) < 0.08)


def test_a_robot_is_the_same_for_the_same_seed_and_id_whoever_else_is_drawn() -> None:
    population = population_of(SIX)
    assert population.draw(3, 7) == population_of(SIX).draw(3, 7)
    assert population.draw(3, 7) != population.draw(3, 8)
    assert population.draw(3, 7) != population.draw(4, 7)


def test_one_robot_varies_by_its_standard_deviations() -> None:
    values = {"wheel_radius": Value(0.04), "k2_over_k3": Value(118.0, 4.0), "k1": Value(0.054, 0.001)}
    population = population_of([ParameterFile(0, {**values, "base_width": Value(0.161, 0.002)})])
    drawn = np.array([list(population.draw(0, robot_id)) for robot_id in range(DRAWS)])
    np.testing.assert_allclose(drawn[:, 0], 0.04, rtol=1e-12)
    np.testing.assert_allclose(drawn[:, 1:].std(axis=0), (4.0, 0.001, 0.002), rtol=0.06)


def test_effects_of_diagnosed_robots_are_drawn_within_the_bounds_of_the_catalogue() -> None:
    files = [robot(0, 100, 0.05, 0.16, coulomb_friction=8.0, gyro_bias=-0.01), robot(1, 110, 0.05, 0.16)]
    files.append(robot(2, 105, 0.051, 0.161, coulomb_friction=1.0))
    population = population_of(files)
    drawn = [population.draw(5, robot_id).effects for robot_id in range(300)]
    for name in ("coulomb_friction", "gyro_bias"):
        values = np.array([effects[name] for effects in drawn])
        assert np.all((values >= definition(name).lower) & (values <= definition(name).upper))
        assert values.std() > 0.0
    assert np.mean([effects["coulomb_friction"] for effects in drawn]) == pytest.approx(3.0, abs=1.0)


def test_a_moment_in_time_is_not_averaged_with_robots_that_have_none() -> None:
    with_change = {one.name: float(one.typical or 1.0) for one in MODELLED["surface_change"].parameters}
    file = robot(0, 100, 0.05, 0.16)
    values = {**file.values, **{name: Value(v) for name, v in with_change.items()}}
    changed = ParameterFile(0, values, ("surface_change",))
    drawn = population_of([changed, robot(1, 104, 0.05, 0.16)]).draw(0, 0)
    assert drawn.effects["surface_change_time"] == pytest.approx(with_change["surface_change_time"])


def test_files_that_do_not_tell_how_robots_differ_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PopulationError, match="no standard deviations"):
        population_of([robot(0, 100, 0.05, 0.16)])
    with pytest.raises(PopulationError, match="needs parameter files"):
        population_of([])
    with pytest.raises(PopulationError, match="cannot be read"):
        drawn_from([tmp_path / "none.yaml"], [1], 0)
    incomplete = ParameterFile(0, {"wheel_radius": Value(0.04)})
    with pytest.raises(PopulationError, match="k2_over_k3"):
        population_of([incomplete, incomplete])
