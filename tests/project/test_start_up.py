"""A command starts without what it does not need, and does not start threads that would be in its way."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cmr.diagnosis.diagnose import p_value
from cmr.estimation.noise import nonnegative
from cmr.experiments.fidelity.distances import wasserstein
from cmr.model.catalogue import CATALOGUE, typical
from cmr.parameters.file import ParameterFile, Value
from cmr.threads import LINEAR_ALGEBRA
from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from documentation.imports import imported_by, modules

NAMES = " ".join(LINEAR_ALGEBRA)
TELL = f"import sys, os, cmr.commands; print('numpy' in sys.modules, *map(os.environ.get, '{NAMES}'.split()))"


def told(environment: dict[str, str]) -> list[str]:
    """What a command finds in its environment once it is being started."""
    free = {name: value for name, value in os.environ.items() if name not in LINEAR_ALGEBRA}
    command = [sys.executable, "-c", TELL]
    return subprocess.run(command, env=free | environment, capture_output=True, text=True, check=True).stdout.split()


def test_linear_algebra_of_a_command_has_one_thread_before_numpy_is_imported() -> None:
    assert told({}) == ["False", "1", "1", "1"]


def test_who_asks_for_threads_has_them() -> None:
    assert told({"OMP_NUM_THREADS": "4"}) == ["False", "1", "4", "1"]


@pytest.mark.slow
def test_nothing_of_ours_imports_the_distributions_of_scipy() -> None:
    for module, path in modules(PROJECT).items():
        names = [name for name, _ in imported_by(ast.parse(path.read_text()))] if path.is_file() else []
        assert not any(name.startswith("scipy.stats") for name in names), module


def printed_by(program: str) -> list[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()


def test_what_runs_on_a_robot_imports_no_numpy() -> None:
    commands = ", ".join(f"cmr.commands.{name}" for name in ("umbrella", "estop", "key", "relay", "doctor"))
    assert printed_by(f"import sys, robot_driver.main, {commands}; print('numpy' in sys.modules)") == ["False"]


def test_parameters_with_effects_are_read_where_there_is_no_numpy(tmp_path: Path) -> None:
    effect = CATALOGUE["deadband"]
    values = {"wheel_radius": 0.04, "k2_over_k3": 80.0, "k1": 0.065, "base_width": 0.2, **typical(effect)}
    path = tmp_path / "robot_0.yaml"
    ParameterFile(0, {name: Value(value) for name, value in values.items()}, (effect.name,)).save(path)
    program = (
        "import sys; sys.modules['numpy'] = None\n"
        "from cmr.parameters.following import ParameterFollower; from pathlib import Path\n"
        f"follower = ParameterFollower(0, Path({str(path)!r}))\n"
        "print(follower.message or follower.parameters.value('k1'))"
    )
    assert printed_by(program) == ["0.065"]


def test_a_world_is_decoded_where_there_is_no_numpy() -> None:
    program = (
        "import sys; sys.modules['numpy'] = None\n"
        "from cmr.bus.messages import decode, make; from cmr.msg import world_state_t as t\n"
        "fields = dict.fromkeys(t.__slots__[2:], [1.0]) | {'robot_id': [7], 'origin': [0]}\n"
        "print(decode('WORLD_STATE', make(t, utime=5, **fields).encode()).message.robot_id[0])"
    )
    assert printed_by(program) == ["7"]


@pytest.mark.parametrize("parameters", [1, 2, 3])
def test_the_tail_of_chi_square_is_that_of_scipy(parameters: int) -> None:
    from scipy.stats import chi2

    for drop in (20.0, 60.0, 400.0, 5000.0):
        expected = chi2.sf(drop / 1.7, parameters)
        assert p_value(drop, parameters, 1.7) / p_value(60.0, parameters, 1.7) == pytest.approx(
            expected / chi2.sf(60.0 / 1.7, parameters), rel=1e-9
        )
    assert p_value(-3.0, parameters, 1.7) == 1.0


@pytest.mark.parametrize("unknowns", [2, 3])
def test_few_nonnegative_unknowns_are_found_as_by_scipy(unknowns: int) -> None:
    from scipy.optimize import nnls

    random = np.random.default_rng(unknowns)
    for _ in range(200):
        matrix, values = random.normal(size=(7, unknowns)), random.normal(size=7)
        expected, _ = nnls(matrix, values)
        assert nonnegative(matrix.T @ matrix, matrix.T @ values) == pytest.approx(expected, abs=1e-9)


def test_the_distance_of_two_sets_is_that_of_scipy() -> None:
    from scipy.stats import wasserstein_distance

    random = np.random.default_rng(4)
    for first, second in ((5, 5), (30, 7), (1, 12)):
        a, b = random.normal(size=first).round(1), random.normal(0.3, 2.0, second).round(1)
        assert wasserstein(a, b) == pytest.approx(wasserstein_distance(a, b), abs=1e-12)
