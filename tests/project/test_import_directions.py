"""Imports run one way, as docs/explanation/architecture.md says: who is below does not know who is above."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.project import PROJECT

BUS = {"bus", "msg"}
RECORDED = {*BUS, "parameters", "model", "recordings"}
# Which packages of cmr each may know beside itself.
KNOWN: dict[str, set[str]] = {
    "colours": set(),
    "configuration": {"document"},
    "distribution": set(),
    "document": set(),
    "structure": {"document", "options"},
    "options": set(),
    "files": set(),
    "news": set(),
    "progress": {"news"},
    "threads": set(),
    "workers": {"threads"},
    "priority": set(),
    "report": {"colours"},
    "msg": set(),
    "model": set(),
    "plant": set(),  # the judge of the model, with which it shares no code
    "bus": {"msg", "configuration", "news"},
    "parameters": {*BUS, "document", "files", "model"},
    "camera": {"msg", "document", "structure", "files"},
    "manoeuvres": {"model"},
    "recordings": {*BUS, "parameters", "model"},
    "estimation": {*RECORDED, "manoeuvres"},
    "calibration": {*RECORDED, "colours", "manoeuvres", "estimation"},
    "world": {*RECORDED, "colours", "manoeuvres"},
    "diagnosis": {*RECORDED, "report", "distribution", "colours", "files", "workers", "manoeuvres", "estimation"},
    "scenario": {*RECORDED, "document", "options", "structure", "files", "progress", "report", "world", "team"},
    "team": {*RECORDED, "plant", "world"},
    "fidelity": {*RECORDED, "colours", "files", "workers", "estimation", "calibration", "diagnosis", "team"},
    "sweep": {*RECORDED, "files", "distribution", "colours", "progress", "scenario", "team", "world"},
    "view": {*RECORDED, "colours", "world"},
    "commands": {
        *{
            *RECORDED,
            "manoeuvres",
            "estimation",
            "calibration",
            "world",
            "diagnosis",
            "scenario",
            "team",
            "fidelity",
            "sweep",
        },
        *("camera", "view", "threads", "priority", "configuration", "distribution", "files", "news", "progress"),
    },
    "robot_log": {*RECORDED, "calibration", "diagnosis", "distribution", "progress"},
    "__main__": {"commands"},
    "tools": {*RECORDED, "document", "files", "colours", "commands", "distribution", "progress"},
}
DRIVER = {
    *BUS,
    "parameters",
    "commands",
    "priority",
    "configuration",
    "news",
    "options",
}  # of commands only how command lines are read


def imports(source: str) -> Iterator[str]:
    """The modules that a source imports, at its top or inside functions."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level <= 1, "an import beyond its own folder is absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names if not node.level)


def packages_known(source: str) -> set[str]:
    """The packages of cmr that a source imports from."""
    parts = [name.split(".") for name in imports(source)]
    return {names[1] for names in parts if names[0] == "cmr" and len(names) > 1}


def files_of(package: str) -> list[Path]:
    """The sources of a package of cmr: a folder, or a module."""
    folder = PROJECT / "cmr" / package
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]


@pytest.mark.parametrize("package", KNOWN)
def test_a_package_knows_only_those_below_it(package: str) -> None:
    for path in files_of(package):
        beyond = packages_known(path.read_text(encoding="utf-8")) - KNOWN[package] - {package}
        assert not beyond, f"{path.relative_to(PROJECT)} imports from {beyond}"


def test_every_package_has_its_place() -> None:
    modules = {path.stem for path in (PROJECT / "cmr").glob("*.py")}
    folders = {path.parent.name for path in (PROJECT / "cmr").glob("*/__init__.py")}
    assert (modules | folders) - {"__init__"} == set(KNOWN)


def test_nobody_knows_in_a_circle() -> None:
    placed: set[str] = set()
    while len(placed) < len(KNOWN):
        free = {package for package, known in KNOWN.items() if package not in placed and known <= placed}
        assert free, f"a circle among {set(KNOWN) - placed}"
        placed |= free


def test_the_driver_knows_neither_world_nor_model() -> None:
    for path in sorted((PROJECT / "robot_driver").glob("*.py")):
        known = {name for name in imports(path.read_text(encoding="utf-8")) if name.startswith("cmr.")}
        assert {name.split(".")[1] for name in known} <= DRIVER, path.name
        commands = {name for name in known if name.startswith("cmr.commands.")}
        assert all(name.startswith("cmr.commands.command_line.") for name in commands), path.name


def test_imports_inside_functions_and_of_whole_rooms_are_seen() -> None:
    late = "def late():\n    from cmr import diagnosis\n    from cmr.model.motion import drive\n"
    source = f"import cmr.world.view\n{late}"
    assert packages_known(source) == {"world", "diagnosis", "model"}
