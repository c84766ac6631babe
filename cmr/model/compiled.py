"""Compile a function with Numba: the one place that knows its options.

`contract` lets a product and a sum become one instruction; anything looser keeps the loops from being vectorised.
Nothing that is compiled is imported until it is needed, because Numba itself takes half a second to import.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import sigutils

P = ParamSpec("P")
R = TypeVar("R")
# Numba has annotations from some version on; this way they make no difference.
jit: Any = numba.njit
signatures: Any = sigutils
config: Any = numba.config
OPTIONS = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True}
LINEAR_ALGEBRA = "scipy.linalg.cython_blas"


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a small function that compiled functions call; it takes the types of its first use."""
    return cast("Callable[P, R]", jit(inline="always", **OPTIONS)(function))


def compiled(signature: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function for one signature when it is first called; later processes find it in Numba's cache."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        if config.DISABLE_JIT:  # by the environment's NUMBA_DISABLE_JIT, to step through the code
            return function
        return cast("Callable[P, R]", _Compiled(signature, function))

    return decorate


class _Compiled:
    """A function that is compiled, or loaded, at its first call; other compiled functions may call it too."""

    def __init__(self, signature: str, function: Callable[..., Any]) -> None:
        self._signature = signature
        self._dispatcher = jit(**OPTIONS)(function)
        with suppress(RuntimeError):  # nowhere to write: each process compiles for itself
            self._dispatcher.enable_caching()
        self._call = self._load

    def __call__(self, *arguments: Any) -> Any:
        return self._call(*arguments)

    @property
    def _numba_type_(self) -> Any:
        """What Numba takes this for where compiled code calls it."""
        return self._dispatcher._numba_type_

    def _load(self, *arguments: Any) -> Any:
        with _without_linear_algebra():
            # By types alone, as compiled callers ask for it: so both find the same in the cache.
            self._dispatcher.compile(signatures.normalize_signature(self._signature)[0])
        self._dispatcher.disable_compile()
        self._call = self._dispatcher
        return self._call(*arguments)


@contextmanager
def _without_linear_algebra() -> Iterator[None]:
    """Keep Numba from importing SciPy, which takes longer than all the rest, to see whether it has linear algebra."""
    if LINEAR_ALGEBRA in sys.modules:
        yield
        return
    sys.modules[LINEAR_ALGEBRA] = cast("Any", None)
    try:
        yield
    finally:
        del sys.modules[LINEAR_ALGEBRA]
