"""Replace functions and values of a driver, and the process of its last gate, by those that break a promise."""

import os
from collections.abc import Callable
from typing import Any

from robot_driver import gate
from tests.support.project import PROJECT


def replace_with(owner: Any, name: str, value: object) -> None:
    """Replace what a module or a class has under this name."""
    setattr(owner, name, value)


def wrap(owner: Any, name: str, around: Callable[..., Any]) -> None:
    """Have `around(original, *arguments)` be called in place of a function."""
    original = getattr(owner, name)
    setattr(owner, name, lambda *arguments, **named: around(original, *arguments, **named))


def break_gate(way: str) -> None:
    """Have the last gate started from `broken_gate`, which breaks it in this way."""
    os.environ["CMR_BROKEN_GATE"], os.environ["CMR_BROKEN_GATE_PATH"] = way, str(PROJECT)
    gate.__file__ = str(PROJECT / "tests" / "support" / "broken_gate" / "__init__.py")
