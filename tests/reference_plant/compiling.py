"""Compile the plant's functions."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba

P = ParamSpec("P")
R = TypeVar("R")
config: Any = numba.config

# Numba compiles a function anew when its own file changes, but not for what it calls in another: all of the plant's
# sources together name the folder in which compiled code is kept.
_FOLDER = Path(__file__).parent
_SOURCES = hashlib.sha256(b"".join(file.read_bytes() for file in sorted(_FOLDER.glob("*.py")))).hexdigest()[:16]


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile with numba; a division by zero gives infinity, as in NumPy."""
    before = config.CACHE_DIR
    config.CACHE_DIR = before or str(_FOLDER / "__pycache__" / _SOURCES)
    try:
        result: Callable[P, R] = numba.njit(cache=True, error_model="numpy")(function)
    finally:
        config.CACHE_DIR = before
    return result
