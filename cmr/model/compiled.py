"""Compile a function with Numba: the one place that knows its options.

`contract` lets a product and a sum become one instruction; anything looser keeps the loops from being vectorised.
Nothing that is compiled is imported until it is needed, because Numba itself takes half a second to import.
"""

import fcntl
import hashlib
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import sigutils

from cmr.model.cache import cache_folder

P = ParamSpec("P")
R = TypeVar("R")
# Numba has annotations from some version on; this way they make no difference.
jit: Any = numba.njit
signatures: Any = sigutils
config: Any = numba.config
OPTIONS = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True}
LINEAR_ALGEBRA = "scipy.linalg.cython_blas"
_ONE_AT_A_TIME = threading.Lock()


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
    """A function that is compiled, or loaded, at its first call; other compiled functions may call it too.

    From then on its name in its module stands for what Numba made of it: a step saves a detour for each call.
    """

    def __init__(self, signature: str, function: Callable[..., Any]) -> None:
        self.unloaded = True
        self._signature = signature
        self._module, self._name = function.__module__, function.__qualname__
        self._dispatcher = jit(**OPTIONS)(function)
        folder = cache_folder() / _sources(Path(function.__code__.co_filename).parent)
        self._lock = folder / f"{self._module}.{self._name}.lock"
        with suppress(RuntimeError), _caching_in(folder):
            self._dispatcher.enable_caching()  # an error if nowhere can be written: each process compiles for itself
        self._call = self._load

    def __call__(self, *arguments: Any) -> Any:
        return self._call(*arguments)

    @property
    def _numba_type_(self) -> Any:
        """What Numba takes this for where compiled code calls it."""
        return self._dispatcher._numba_type_

    def _load(self, *arguments: Any) -> Any:
        # Processes that are begun together would all compile the same: others wait, and load what the first compiled.
        with _without_linear_algebra(), _alone(self._lock):
            # By types alone, as compiled callers ask for it: so both find the same in the cache.
            self._dispatcher.compile(signatures.normalize_signature(self._signature)[0])
        self._dispatcher.disable_compile()
        self._call, self.unloaded = self._dispatcher, False
        module = sys.modules.get(self._module)
        if getattr(module, self._name, None) is self:
            setattr(module, self._name, self._dispatcher)
        return self._call(*arguments)


@cache
def _sources(folder: Path) -> str:
    """Return a name for the state of the model's source files, and of those in a folder of this package.

    Numba compiles a function again when its own file changes; what is inlined into it comes from other files.
    """
    here = Path(__file__).parent
    folders = [here, folder] if folder.is_relative_to(here.parent) and folder != here else [here]
    files = [file for folder in folders for file in sorted(folder.glob("*.py"))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


@contextmanager
def _caching_in(folder: Path) -> Iterator[None]:
    """Let Numba choose this folder for what it caches, unless the user has chosen one (NUMBA_CACHE_DIR)."""
    with _ONE_AT_A_TIME:  # the option is everybody's, and modules are imported by several threads
        before = config.CACHE_DIR
        config.CACHE_DIR = before or str(folder)
        try:
            yield
        finally:
            config.CACHE_DIR = before


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Keep other processes out of what this file stands for; where it cannot be written they are not."""
    with ExitStack() as held:
        with suppress(OSError):
            lock.parent.mkdir(parents=True, exist_ok=True)
            fcntl.flock(held.enter_context(lock.open("w")), fcntl.LOCK_EX)
        yield


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
