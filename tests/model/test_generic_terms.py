"""Generic terms: products without a cause that the model can add up, and that cost nothing where there are none."""

from pathlib import Path

import numpy as np
import pytest

from cmr.model.catalogue import CATALOGUE, GENERIC_TERMS, with_effects
from cmr.model.effect import GENERIC
from cmr.model.extended.model import model_of
from cmr.model.fleet import Fleet
from cmr.model.motion import RobotState, Trajectory, drive
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile, Value, load

ROBOT = RobotParameters(wheel_radius=0.04, k2_over_k3=118.0, k1=0.054, base_width=0.161)
DT, STEPS = 0.01, 300
PARAMETERS = [parameter for term in GENERIC_TERMS.values() for parameter in term.parameters]


def driven(values: dict[str, float], theta: float = 0.0, steady: bool = False) -> Trajectory:
    """A drive to and fro, or straight on."""
    time = DT * np.arange(STEPS)
    left, right = (np.full(STEPS, 0.5),) * 2 if steady else (0.8 * np.sin(3.0 * time), 0.6 * np.sin(2.3 * time + 0.4))
    return drive(left, right, np.full(STEPS, DT), with_effects(ROBOT, values), RobotState.at_rest(0.0, 0.0, theta))


def test_generic_terms_are_no_effects_of_the_catalogue_and_say_that_they_have_no_cause() -> None:
    assert not set(GENERIC_TERMS) & set(CATALOGUE)
    assert all(term.group == GENERIC and "no physical cause" in term.cause for term in GENERIC_TERMS.values())


def test_products_that_are_neutral_leave_the_motion_as_it_is_bit_for_bit() -> None:
    for neutral, without in zip(driven({p.name: 0.0 for p in PARAMETERS}), driven({}), strict=True):
        assert np.array_equal(neutral, without)


def test_models_without_generic_terms_are_compiled_without_them() -> None:
    plain = model_of(["k1", "coulomb_friction"])
    assert not {parameter.name for parameter in PARAMETERS} & set(plain.definitions)
    assert model_of(["k1", PARAMETERS[0].name]) is not plain


@pytest.mark.further  # two of them have closed forms, below
def test_every_product_changes_the_motion() -> None:
    sizes = {p.name: np.where(np.arange(len(PARAMETERS)) == k, p.typical or 0.0, 0.0) for k, p in enumerate(PARAMETERS)}
    moved, plain = driven(sizes), driven({})  # type: ignore[arg-type]
    off = np.hypot(moved.x - plain.x[:, None], moved.y - plain.y[:, None]).max(axis=0)
    assert {p.name: size for p, size in zip(PARAMETERS, off, strict=True) if not size > 1e-4} == {}


def test_a_product_of_the_wheels_speed_is_the_drag_that_does_the_same() -> None:
    drag = 0.05
    share = -drag / (ROBOT.k2_over_k3 * ROBOT.k1**2)
    for generic, named in zip(driven({"generic_drive_s_abs_s": share}), driven({"quadratic_drag": drag}), strict=True):
        assert generic == pytest.approx(named, abs=1e-9)


@pytest.mark.parametrize("theta", [0.0, np.pi / 3.0, np.pi])
def test_a_product_with_the_heading_lets_the_robot_drift_in_a_direction_of_the_world(theta: float) -> None:
    moved = driven({"generic_motion_aside_abs_v_cos": 0.1}, theta, steady=True)
    along = moved.x[-1] * np.cos(theta) + moved.y[-1] * np.sin(theta)
    aside = moved.y[-1] * np.cos(theta) - moved.x[-1] * np.sin(theta)
    assert aside == pytest.approx(0.1 * np.cos(theta) * along, rel=1e-9)


def test_a_file_with_a_generic_term_is_read_back_and_runs_in_a_fleet_as_it_is(tmp_path: Path) -> None:
    values = {**ROBOT.values, "coulomb_friction": 2.0, "generic_drive_u_cubed": 0.4}
    used = ("coulomb_friction", "generic_drive")
    path = tmp_path / "robot_0.yaml"
    ParameterFile(0, {name: Value(value) for name, value in values.items()}, used).save(path)
    read = load(path)
    assert read.effects == used
    fleet = Fleet(DT)
    robots = fleet.add(RobotState.at_rest(), read.robot_parameters)
    others = fleet.add(RobotState.at_rest(), ROBOT)
    fleet.command(slice(None), 0.6, 0.5)
    fleet.advance(100)
    spans = np.full(100, 0.6), np.full(100, 0.5), np.full(100, DT)
    alone = drive(*spans, read.robot_parameters, RobotState.at_rest())
    assert fleet.states(robots).x == pytest.approx(alone.x[-1], abs=1e-9)
    assert fleet.states(others).x == pytest.approx(drive(*spans, ROBOT, RobotState.at_rest()).x[-1], abs=1e-9)
