"""What of CMR runs on a robot's own computer: the driver, a few commands, and the modules that these import.

The list follows from the imports, so that it is complete and has nothing else.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

from documentation.imports import GENERATED, PROJECT, TOP, TYPING, Import, imports, modules

from cmr.commands.catalogue import COMMANDS

COMMANDS_THERE = ("driver", "bringup", "accept", "doctor", "estop", "key", "relay", "agent")
ENTRY = "cmr.commands"  # has a function for every command, of which most are not there
STARTED = ("cmr", ENTRY, "cmr.commands.umbrella", *(COMMANDS[name][0] for name in COMMANDS_THERE))
DEVICES = "robot_driver"
NOT_ON_A_ROBOT = (
    "robot_driver.emulator",
    "robot_driver.ros2",
    "robot_driver.simulated",
    "robot_driver.acceptance.page",
)
LIBRARIES = ("lcm", "serial", "yaml")  # by the names of their modules
# What these modules import and do without, and how.
WITHOUT = {
    ("cmr.bus.world_state", "numpy"): "it is imported when a WORLD_STATE comes, where NumPy is installed",
    ("cmr.bus.possible", "numpy"): "it is imported when worlds or paths come, for which no driver listens",
    ("cmr.commands.doctor", "rich"): "a table without colours",
    ("cmr.model.catalogue", "numpy"): "of many robots at once",
    ("cmr.model.compiled", "numba"): "it is imported when the formula of a law is evaluated, which no driver does",
    ("cmr.model.laws.evaluating", "numpy"): "the same",
    ("cmr.model.remembered_types", "numba"): "the same",
    ("cmr.model.parameters", "numpy"): "of many robots at once",
    ("cmr.model.velocity_controller", "numpy"): "of robots that cmr-driver does not drive",
}
ASKED_FOR = "cmr.commands.first_use"  # the doctor looks whether it is there


@cache
def modules_there(project: Path = PROJECT) -> tuple[str, ...]:
    """Return the modules, by their full names; the generated messages count as one."""
    sources = modules(project)
    devices = [name for name in sources if _is_in(name, DEVICES) and not _is_in(name, *NOT_ON_A_ROBOT)]
    return tuple(sorted(_reached([*STARTED, *devices], imports(sources), sources)))


@cache
def files_there(project: Path = PROJECT) -> tuple[str, ...]:
    """Return the files of these modules in an import root, such as a checkout in which the messages were generated."""
    sources = modules(project)
    found = {GENERATED.replace(".", "/") + f"/{path.name}" for path in sources[GENERATED].glob("*.py")}
    found |= {sources[name].relative_to(project).as_posix() for name in modules_there(project) if name != GENERATED}
    return tuple(sorted(found))


def _reached(starts: Iterable[str], found: Iterable[Import], sources: Mapping[str, Path]) -> set[str]:
    """Return the modules that importing some leads to, with the packages in which they lie."""
    followed: dict[str, list[str]] = {}
    for one in found:
        if one.kind != TYPING and one.imported != ASKED_FOR and (one.importer != ENTRY or one.kind == TOP):
            followed.setdefault(one.importer, []).append(one.imported)
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
