"""Compile a function with Numba: the one place that knows its options.

`contract` lets a product and a sum become one instruction; anything looser keeps the loops from being vectorised.
Nothing that is compiled is imported until it is needed, because Numba itself takes half a second to import.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")
# Numba has annotations from some version on; this way they make no difference.
jit: Any = numba.njit
OPTIONS = {"cache": True, "fastmath": {"contract"}, "error_model": "numpy", "nogil": True}


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a small function that compiled functions call; it takes the types of its first use."""
    return cast("Callable[P, R]", jit(inline="always", **OPTIONS)(function))


def compiled(signature: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function at once for one signature; later processes find the result in Numba's cache."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        return cast("Callable[P, R]", jit(signature, **OPTIONS)(function))

    return decorate
