"""What scripts import is there: most of them are run by hand, long after a name was moved."""

import ast
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.project import PROJECT

SCRIPTS = PROJECT / "scripts"
OURS = ("cmr", "cmr_tools", "robot_driver", "tests", "scripts")
PYTHON = b"#!/usr/bin/env python"

sys.path.insert(0, str(SCRIPTS))


def python_files() -> Iterator[Path]:
    """Yield the scripts, with or without a suffix, and the modules of their packages."""
    for path in sorted(SCRIPTS.rglob("*")):
        if path.is_file() and (path.suffix == ".py" or path.read_bytes().startswith(PYTHON)):
            yield path


def imported(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the modules of ours that a file imports, also inside functions, each with a name in it or an empty one."""
    packages = (*OURS, *(folder.name for folder in SCRIPTS.iterdir() if folder.is_dir()))
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            found = [(node.module, alias.name) for alias in node.names]
        elif isinstance(node, ast.Import):
            found = [(alias.name, "") for alias in node.names]
        else:
            continue
        yield from ((module, name) for module, name in found if module.partition(".")[0] in packages)


def is_there(module: str, name: str) -> bool:
    if not name or hasattr(importlib.import_module(module), name):
        return importlib.util.find_spec(module) is not None
    try:
        return importlib.util.find_spec(f"{module}.{name}") is not None
    except ModuleNotFoundError:  # the module is no package
        return False


@pytest.mark.parametrize("path", list(python_files()), ids=lambda path: path.relative_to(SCRIPTS).as_posix())
def test_what_a_script_imports_is_there(path: Path) -> None:
    assert [f"{module}.{name}" for module, name in imported(path) if not is_there(module, name)] == []


def test_scripts_without_a_suffix_are_looked_at_too() -> None:
    assert {SCRIPTS / "bench", SCRIPTS / "uncertainty_study", SCRIPTS / "build_messages.py"} <= set(python_files())
