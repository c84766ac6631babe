"""What is compiled the first time on a computer is compiled before anything drives, once, and announced."""

import subprocess
import sys
import threading
import time
from importlib import import_module
from pathlib import Path

import pytest

from cmr.cli.errors import CommandError
from cmr.commands import doctor, first_use
from cmr.commands.demo import free_folder
from cmr.commands.demo import main as demo
from cmr.commands.first_use import BEHAVIOURS, EMULATOR, ESTIMATOR, MODEL, OBSERVER, WORLD, compile_first
from cmr.commands.run import parts_to_compile
from cmr.commands.scenarios import load
from cmr.experiments.scenario.reading import path_of
from cmr.geometry.manoeuvres import TYPICAL
from cmr.model.parameters import RobotParameters
from cmr.world import loading
from cmr.world.loading import Loader
from tests.support.private_bus import private_url

pytestmark = pytest.mark.slow

LOAD = """
from numba.core import event
from cmr.geometry.manoeuvres import TYPICAL
from cmr.model.parameters import RobotParameters
from cmr.world.loading import Loader
from tests.support.private_bus import private_url
with event.install_recorder("numba:compile") as compiled:
    for effects in ({}, {"coulomb_friction": 0.3}):
        loader, parameters = Loader(), RobotParameters.of({**TYPICAL.values, **effects})
        while not loader.ready(parameters):  # what is no longer starting is ready, or has failed
            assert loader.is_starting or loader.ready(parameters), loader.message
print(len(compiled.buffer))
"""

CALIBRATE = """
from numba.core import event
from cmr.calibration.calibrator import Calibrator
with event.install_recorder("numba:compile") as compiled:
    Calibrator(0).load()
print(*(done.data["dispatcher"].py_func.__qualname__ for _, done in compiled.buffer))
"""

# The compiled functions of the world that none of the parts has loaded.
LEFT = """
from importlib import import_module
from pkgutil import walk_packages
import cmr.world
from cmr.commands.first_use import BEHAVIOURS, WORLD, main
main([WORLD, BEHAVIOURS])
for module in (import_module(found.name) for found in walk_packages(cmr.world.__path__, "cmr.world.")):
    for name, value in list(vars(module).items()):
        if getattr(value, "unloaded", False) is True:
            print(f"{module.__name__}.{name}")
"""


@pytest.fixture
def compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of what is compiled, by nobody, for a cache that is empty at first."""
    names: list[str] = []

    def compile_nothing(name: str, mark: Path) -> str:
        names.append(name)
        mark.touch()
        return ""

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(first_use, "_compile", compile_nothing)
    return names


def test_each_part_is_compiled_once_and_announced(compiled: list[str]) -> None:
    said: list[str] = []
    compile_first([MODEL, WORLD], said.append)
    assert sorted(compiled) == sorted([MODEL, WORLD])
    assert said[0].startswith("Compiling the robot model and the world (first use on this computer, about ")
    assert said[0].endswith(" s on an idle one) ...")
    assert said[1].startswith("Compiled in ")
    compile_first([MODEL, WORLD], said.append)
    compile_first([WORLD, EMULATOR], said.append)
    assert sorted(compiled) == sorted([MODEL, WORLD, EMULATOR])
    assert len(said) == 4


@pytest.mark.usefixtures("compiled")
def test_doctor_says_what_is_not_compiled_yet() -> None:
    assert (
        "the observer, the estimator, the robot model, the world, behaviours and the emulated robot"
        in doctor.compiled_model().sentence
    )
    compile_first([MODEL, WORLD, BEHAVIOURS, EMULATOR])
    assert doctor.compiled_model().sentence.startswith("Not compiled yet: the observer and the estimator. ")
    compile_first([ESTIMATOR])
    assert doctor.compiled_model().colour == doctor.GREEN


def test_what_a_part_needs_is_compiled_with_it(compiled: list[str]) -> None:
    compile_first([ESTIMATOR], lambda _text: None)
    assert sorted(compiled) == sorted([ESTIMATOR, OBSERVER, MODEL])


def test_all_parts_are_compiled_where_none_is_named(compiled: list[str]) -> None:
    assert first_use.main([]) == 0
    assert sorted(compiled) == sorted(first_use.PARTS)


def test_what_changed_is_compiled_anew(compiled: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    compile_first([MODEL], lambda _text: None)
    monkeypatch.setattr(first_use, "_processor", lambda: "another one")
    compile_first([MODEL], lambda _text: None)
    assert compiled == [MODEL, MODEL]


def test_a_part_that_cannot_be_compiled_is_reported_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(first_use, "PARTS", {"nothing": first_use.Part("nothing", 1, lambda: None)})
    said: list[str] = []
    for _ in range(2):
        compile_first(["nothing"], said.append)
    assert [text.startswith("Not compiled: KeyError") for text in said] == [False, True, False, True]


def test_in_another_checkout_the_cmr_that_runs_is_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cmr" / "commands").mkdir(parents=True)
    for name in ("__init__", "commands/__init__"):
        (tmp_path / "cmr" / f"{name}.py").touch()
    (tmp_path / "cmr" / "commands" / "first_use.py").write_text("raise SystemExit('the other one')")
    monkeypatch.chdir(tmp_path)
    assert first_use._compile("no such part", tmp_path / "mark").startswith("KeyError")


@pytest.mark.slow
def test_a_simulator_compiles_nothing_after_that() -> None:
    compile_first([MODEL, WORLD])
    result = subprocess.run([sys.executable, "-c", LOAD], capture_output=True, text=True)
    assert (result.stdout.split(), result.returncode) == (["0"], 0), result.stderr


@pytest.mark.slow
def test_an_estimator_compiles_nothing_after_that() -> None:
    compile_first([ESTIMATOR])
    result = subprocess.run([sys.executable, "-c", CALIBRATE], capture_output=True, text=True)
    assert (result.stdout.split(), result.returncode) == ([], 0), result.stderr


@pytest.mark.slow
def test_no_behaviour_is_compiled_while_robots_drive() -> None:
    compile_first([WORLD, BEHAVIOURS])
    result = subprocess.run([sys.executable, "-c", LEFT], capture_output=True, text=True)
    assert (result.stdout.split(), result.returncode) == ([], 0), result.stderr


def test_a_run_compiles_what_its_processes_take() -> None:
    scenario = load(path_of("line"))
    assert {MODEL, WORLD, BEHAVIOURS, EMULATOR} <= parts_to_compile(scenario, Path())
    assert (ESTIMATOR in parts_to_compile(scenario, Path())) == any(r.calibrate or r.diagnose for r in scenario.robots)


def test_a_simulator_is_starting_until_a_robot_can_move(monkeypatch: pytest.MonkeyPatch) -> None:
    gate = threading.Event()

    def prepare(_loader: Loader) -> None:
        gate.wait()

    monkeypatch.setattr(loading.Loader, "_prepare_behaviours", prepare)
    loader, parameters = Loader(), RobotParameters.of(TYPICAL.values)
    assert not loader.is_starting  # there is nobody to be moved
    assert not loader.ready(parameters)
    assert loader.is_starting
    gate.set()
    while not loader.ready(parameters):
        time.sleep(0.01)  # without it, this thread would take most of the time that the loading one needs
    assert not loader.is_starting


def test_a_simulator_loads_nothing_beside_what_compiles_at_first_use(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    loaded: list[object] = []
    monkeypatch.setattr(loading.Loader, "_load", lambda _loader, key, _parameters: loaded.append(key))

    def compile_first(_names: list[str]) -> None:
        raise InterruptedError

    sim = import_module("cmr.commands.sim")  # the package has a function of that name
    monkeypatch.setattr(sim, "compile_first", compile_first)
    with pytest.raises(InterruptedError):
        sim.main(["--virtual", "10=figure_eight", "--parameters", str(tmp_path), "--lcm-url", private_url()])
    assert not loaded


def test_the_demo_keeps_an_earlier_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = tmp_path / "demo-run" / "run.lcm"
    run.parent.mkdir()
    run.write_bytes(b"a drive")
    with pytest.raises(CommandError, match="holds a run already"):
        demo(["--out", "demo-run"])
    assert free_folder(None) == Path("demo-run")
    [earlier] = tmp_path.glob("demo-run-*/run.lcm")
    assert earlier.read_bytes() == b"a drive"
    assert not run.parent.exists()
