"""Find the modules that run on a robot's own computer: the driver, a few commands, and the modules they import.

The list is computed from the imports, so it is complete and minimal.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

from documentation.imports import GENERATED, PROJECT, TOP, TYPING, Import, imports, modules

from cmr.commands.catalogue import COMMANDS

DRIVER_COMMANDS = ("driver", "bringup", "accept", "doctor", "estop", "key", "relay", "agent")
ENTRY = "cmr.commands"  # has a function for every command; most commands are not installed on a robot
ROOTS = ("cmr", ENTRY, "cmr.commands.umbrella", *(COMMANDS[name][0] for name in DRIVER_COMMANDS))
DEVICES = "robot_driver"
EXCLUDED = (
    "robot_driver.emulator",
    "robot_driver.ros2",
    "robot_driver.simulated",
    "robot_driver.acceptance.page",
)
LIBRARIES = ("lcm", "serial", "yaml")  # names of their modules
# Libraries that these modules import but that are not installed on a robot, and why they work without.
OPTIONAL_IMPORTS = {
    ("cmr.bus.world_state", "numpy"): "imported when a WORLD_STATE arrives, only if NumPy is installed",
    ("cmr.bus.possible", "numpy"): "imported when world states or paths arrive; the driver subscribes to neither",
    ("cmr.commands.doctor", "rich"): "the table then has no colours",
    ("cmr.model.catalogue", "numpy"): "used for many robots at once",
    ("cmr.model.compiled", "numba"): "imported when the formula of a law is evaluated, which the driver does not do",
    ("cmr.model.laws.evaluating", "numpy"): "imported when the formula of a law is evaluated",
    ("cmr.model.remembered_types", "numba"): "imported when the formula of a law is evaluated",
    ("cmr.model.parameters", "numpy"): "used for many robots at once",
    ("cmr.model.velocity_controller", "numpy"): "used for robots that cmr-driver does not drive",
}
PROBED = "cmr.commands.first_use"  # cmr doctor only checks whether it is installed


@cache
def driver_modules(project: Path = PROJECT) -> tuple[str, ...]:
    """Return the full names of the modules that run on a robot; the generated messages count as one."""
    sources = modules(project)
    devices = [name for name in sources if _is_in(name, DEVICES) and not _is_in(name, *EXCLUDED)]
    return tuple(sorted(_reached([*ROOTS, *devices], imports(sources), sources)))


@cache
def driver_files(project: Path = PROJECT) -> tuple[str, ...]:
    """Return the files of these modules, relative to an import root, such as a checkout with generated messages."""
    sources = modules(project)
    found = {GENERATED.replace(".", "/") + f"/{path.name}" for path in sources[GENERATED].glob("*.py")}
    found |= {sources[name].relative_to(project).as_posix() for name in driver_modules(project) if name != GENERATED}
    return tuple(sorted(found))


def _reached(starts: Iterable[str], found: Iterable[Import], sources: Mapping[str, Path]) -> set[str]:
    """Return all modules imported from `starts`, directly or indirectly, and the packages that contain them."""
    followed: dict[str, list[str]] = {}
    for each in found:
        if each.kind != TYPING and each.imported != PROBED and (each.importer != ENTRY or each.kind == TOP):
            followed.setdefault(each.importer, []).append(each.imported)
    reached: set[str] = set()
    waiting = list(starts)
    while waiting:
        name = waiting.pop()
        if name in sources and name not in reached:
            reached.add(name)
            waiting += [*followed.get(name, ()), *_packages(name)]
    return reached


def _packages(name: str) -> Iterator[str]:
    while "." in name:
        name = name.rpartition(".")[0]
        yield name


def _is_in(name: str, *packages: str) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)
