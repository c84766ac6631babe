"""Compile the plant's functions."""

import fcntl
import functools
import hashlib
import os
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")
config: Any = numba.config

# Numba compiles a function again when its own file changes, but not when a file that it calls does: so the cache folder
# is named by a hash of all of the plant's sources.
_SOURCES = hashlib.sha256(
    b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py")))
).hexdigest()
# Not beside the sources, where Numba would keep it: pip leaves behind what it has not installed, and such a folder
# hides the checkout from a later `pip install -e`.
_FOLDER = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cmr" / f"plant-{_SOURCES[:16]}"


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile with numba; a division by zero gives infinity, as in NumPy."""
    result: Any = numba.njit(error_model="numpy")(function)
    if config.DISABLE_JIT:
        return function
    before = config.CACHE_DIR
    config.CACHE_DIR = before or str(_FOLDER)
    try:
        with suppress(RuntimeError, OSError):  # if nothing can be written, each process compiles for itself
            result.enable_caching()
    finally:
        config.CACHE_DIR = before
    return cast("Callable[P, R]", result)


def compiled_once(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function called from outside; processes started together wait for the first of them, then load its
    code.
    """
    result = compiled(function)
    if config.DISABLE_JIT:
        return function

    called_before = False

    @functools.wraps(function)
    def called(*arguments: P.args, **options: P.kwargs) -> R:
        nonlocal called_before
        if called_before:
            return result(*arguments, **options)
        called_before = True
        with ExitStack() as held:
            with suppress(OSError):  # if nothing can be written, each process compiles for itself
                _FOLDER.mkdir(parents=True, exist_ok=True)
                fcntl.flock(held.enter_context((_FOLDER / "lock").open("w")), fcntl.LOCK_EX)
            return result(*arguments, **options)

    vars(called)["compiled"] = result
    return called


def loaded(function: Callable[P, R]) -> Callable[P, R]:
    """Return the compiled function of `compiled_once`, to be called without its wrapper; it must have been called once
    before.
    """
    return cast("Callable[P, R]", getattr(function, "compiled", function))
