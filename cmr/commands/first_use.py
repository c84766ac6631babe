"""Compile at first use on a computer: announced, and before anything drives.

A command calls `compile_first` before it starts anything time-critical. Each part is compiled in a process of its own,
as many at once as there are cores; a file marks compiled parts, so that later starts are fast.
"""

import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, NamedTuple

from cmr.cli.progress import Progress
from cmr.model.cache import lasting_folder

MODEL, WORLD, BEHAVIOURS, EMULATOR = "model", "world", "behaviours", "emulator"
OBSERVER, ESTIMATOR = "observer", "estimator"
HERE = Path(__file__).resolve().parents[1]
COMPILED = ("model", "world", "plant", "estimation", "calibration")  # packages with compiled functions
FIRST_USE = "first use on this computer"
NOT_TO_BE_COMPILED = "NUMBA_DISABLE_JIT"  # environment variable that disables compilation, for debugging


class Part(NamedTuple):
    """A part to compile: its description, compile time on one core [s], loader, and dependencies."""

    words: str
    seconds: int
    load: Callable[[], None]
    needs: tuple[str, ...] = ()


def compile_first(names: Iterable[str], say: Callable[[str], None] | None = None) -> None:
    """Compile those of PARTS that this computer has not compiled yet; `say` gets a line before and one after."""
    missing = not_compiled(names)
    if not missing:
        return
    say = say or Progress().say
    say(f"Compiling {in_words(missing)} ({FIRST_USE}, about {seconds_of(missing)} s on an idle one) ...")
    began = time.monotonic()
    with ThreadPoolExecutor(_cores()) as pool:
        failures = [failure for failure in pool.map(_compile, missing, missing.values()) if failure]
    if failures:
        say(f"Not compiled: {failures[0]}")  # whoever needs it compiles it, or says more clearly what is wrong
    else:
        say(f"Compiled in {time.monotonic() - began:.0f} s.")


def not_compiled(names: Iterable[str]) -> dict[str, Path]:
    """Return those of PARTS that are not compiled yet on this computer, each with its marker file.

    Their dependencies are included. The slowest come first. Nothing is returned if the environment disables
    compilation, or nothing can be stored.
    """
    if os.environ.get(NOT_TO_BE_COMPILED, "0") != "0":
        return {}
    wanted = {one for name in names if name in PARTS for one in (name, *PARTS[name].needs)}
    marks = {name: _mark(name) for name in PARTS if name in wanted}
    return {name: mark for name, mark in marks.items() if mark is not None and not mark.exists()}


def announce_compiling() -> None:
    """Print a message once if anything has to be compiled in this process from now on."""
    from numba.core import event as untyped

    event: Any = untyped  # Numba has no annotations

    class _FirstTime(untyped.Listener):
        def on_start(self, _event: object) -> None:
            event.unregister("numba:compile", self)
            Progress().say(f"Compiling the robot model ({FIRST_USE}, about a minute on an idle one) ...")

        def on_end(self, _event: object) -> None:
            pass

    event.register("numba:compile", _FirstTime())


def in_words(names: Iterable[str]) -> str:
    """Describe these parts in words."""
    *others, last = (PARTS[name].words for name in names)
    return f"{', '.join(others)} and {last}" if others else last


def seconds_of(names: Iterable[str]) -> int:
    """Return the time to compile these side by side on an idle computer [s]."""
    each = [PARTS[name].seconds for name in names]
    return max(max(each), sum(each) // _cores())


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _compile(name: str, mark: Path) -> str:
    """Compile a part in a process of its own; return the error, empty if there was none."""
    command = [sys.executable, "-m", "cmr.commands.first_use", name]
    nothing, here = subprocess.DEVNULL, HERE.parent  # in another checkout, -m would find and compile that one
    result = subprocess.run(command, cwd=here, stdin=nothing, capture_output=True, text=True, check=False)
    if result.returncode:
        return (result.stderr.strip().splitlines() or ["nothing was said"])[-1]
    mark.touch()
    return ""


def _mark(name: str) -> Path | None:
    """Return the file that marks that a part was compiled; None if nothing can be stored."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(chosen) if chosen else lasting_folder()
    return folder / f"compiled-{name}-{_state()}" if folder is not None and folder.is_dir() else None


def _state() -> str:
    """Return a name for everything compiled code depends on: sources, Python, Numba and the processor."""
    sources = [path for package in COMPILED for path in sorted((HERE / package).rglob("*.py"))]
    compilers = [Path(found.origin) for name in ("numba", "llvmlite") if (found := find_spec(name)) and found.origin]
    files = [f"{path} {(status := path.stat()).st_size} {status.st_mtime_ns}" for path in (*sources, *compilers)]
    return hashlib.sha256("\n".join([*files, sys.version, _processor()]).encode()).hexdigest()[:16]


def _processor() -> str:
    """Return the name and features of the processor on Linux; elsewhere empty."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").partition("\n\n")[0].splitlines()
    except OSError:
        return ""
    return "\n".join(line for line in lines if line.startswith(("model name", "flags", "Features")))


def _load_model() -> None:
    """Simulate a robot of the paper's model, and one with an effect and late commands."""
    import numpy as np

    from cmr.geometry.manoeuvres import TYPICAL
    from cmr.model.fleet import Fleet
    from cmr.model.motion import RobotState
    from cmr.model.parameters import RobotParameters

    fleet = Fleet(0.01)
    for effects in ({}, {"coulomb_friction": 0.1, "command_delay": 0.02}):
        fleet.add(RobotState.at_rest(np.zeros(1)), RobotParameters.of({**TYPICAL.values, **effects}))
    fleet.command(slice(0, 2), np.zeros(2), np.zeros(2))
    fleet.advance()
    fleet.bodies()
    fleet.states()


def _load_world() -> None:
    """Load contacts, neighbours and range sensors."""
    _load_all_of("cmr.world")
    _load_all_of("cmr.world.interaction")


def _load_behaviours() -> None:
    """Load all shipped behaviours, before a first turn would."""
    _load_all_of("cmr.world.behaviours")


def _load_all_of(package: str) -> None:
    """Load the compiled functions of all modules of a package."""
    for found in iter_modules(import_module(package).__path__, f"{package}."):
        for function in list(vars(import_module(found.name)).values()):
            _load_one(function)


def _load_one(function: Any) -> None:
    """Load a function if it is a compiled one."""
    if getattr(function, "unloaded", False) is True:
        function.loaded()


def _load_emulator() -> None:
    """Start an emulated robot."""
    from robot_driver.emulator.plant import Plant
    from robot_driver.emulator.settings import load_settings

    Plant(load_settings(None))


def _load_observer() -> None:
    """Load what compares the model with recorded sensors."""
    from cmr.model.observer import loops
    from cmr.model.observer.sensor_effects import sensing

    sensing(())
    _load_one(loops.observe)


def _load_estimator() -> None:
    """Load the compiled functions of a fit, besides model and observer."""
    from cmr.model.commands import fill_profile, fill_profiles
    from cmr.model.paper import drive

    _load_all_of("cmr.estimation")
    _load_all_of("cmr.estimation.unexplained")
    for function in (drive, fill_profile, fill_profiles):
        _load_one(function)


PARTS = {
    OBSERVER: Part("the observer", 9, _load_observer),
    ESTIMATOR: Part("the estimator", 7, _load_estimator, (MODEL, OBSERVER)),
    MODEL: Part("the robot model", 7, _load_model),
    WORLD: Part("the world", 7, _load_world),
    BEHAVIOURS: Part("behaviours", 5, _load_behaviours),
    EMULATOR: Part("the emulated robot", 5, _load_emulator),
}


def main(arguments: list[str]) -> int:
    """Compile the named parts in this process; without any, all missing ones, as at a first use."""
    from cmr.model.remembered_types import remembered

    with remembered():
        for name in arguments:
            PARTS[name].load()
    if not arguments:
        compile_first(PARTS)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
