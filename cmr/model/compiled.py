"""Compile functions with Numba: the only module with its options, and with extensions beyond Numba's Python.

`contract` allows fused multiply-add; anything more permissive prevents vectorisation. Nothing is imported for
compilation until needed, because importing Numba takes half a second.
"""

import fcntl
import hashlib
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeAlias, TypeVar, cast

import numba
from numba.core import sigutils, types
from numba.core.typing import templates
from numba.extending import lower_builtin, type_callable

from cmr.model.cache import cache_folder
from cmr.model.remembered_types import remembered

P = ParamSpec("P")
R = TypeVar("R")
# Newer versions of Numba have annotations; this makes the type checks independent of the version.
Numba: TypeAlias = Any
jit: Numba = numba.njit
signatures: Numba = sigutils
kinds: Numba = types
typing: Numba = templates
typed: Numba = type_callable
lowered: Numba = lower_builtin
config: Numba = numba.config
# Our functions are not called from C: without that support they compile slightly faster.
OPTIONS = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
LINEAR_ALGEBRA = "scipy.linalg.cython_blas"
_ONE_AT_A_TIME = threading.Lock()


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a small function for inlining into compiled functions; it takes the types of its first use."""
    return cast("Callable[P, R]", jit(inline="always", **OPTIONS)(function))


def part(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a part of a long function that allocates nothing; it takes the types of its first use.

    Numba compiles it on its own, which for more than a few lines is faster than `inlined`, and LLVM inlines it: passing
    structures to it would cost time.
    """
    options = {**OPTIONS, "no_cpython_wrapper": True, "forceinline": True, "_nrt": False}
    return cast("Callable[P, R]", jit(**options)(function))


def structure(kind: type[tuple[Numba, ...]], *fields: Numba) -> Numba:
    """Return Numba's type of a named tuple with fields of these types: text, or other structures.

    Calling a function with one from Python takes some extra microseconds, so it is for longer computations.
    """
    return kinds.BaseTuple.from_types([_typed(field) for field in fields], kind)


def compiled(*signature: Numba, allocates: bool = True) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function for one signature when it is first called; later processes find it in Numba's cache.

    The signature is a text, or one argument type each, as text or `structure`. Numba counts the references to arrays,
    also wherever a structure with arrays is used. A function that allocates nothing needs no counts; with many
    structures that saves a fifth of its time.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        if config.DISABLE_JIT:  # environment variable NUMBA_DISABLE_JIT, for debugging
            return function
        return cast("Callable[P, R]", _Compiled(_argument_types(signature), function, allocates))

    return decorate


def address(function: Callable[P, None]) -> Callable[P, None]:
    """Return the address of a compiled function, for `call`.

    The function is loaded or compiled now, and must be kept alive while in use. Without compilation, the function
    itself is returned.
    """
    dispatcher: Numba = function.loaded() if isinstance(function, _Compiled) else function
    if not hasattr(dispatcher, "overloads"):
        return function
    [made] = dispatcher.overloads.values()
    return cast("Callable[P, None]", made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


def _argument_types(signature: tuple[Numba, ...]) -> tuple[Numba, ...]:
    whole = len(signature) == 1 and isinstance(signature[0], str)
    known = signatures.normalize_signature(signature[0])[0] if whole else map(_typed, signature)
    return tuple(known)


def _typed(written: Numba) -> Numba:
    """Return Numba's type of this name; types are returned unchanged."""
    return signatures.normalize_signature(f"({written},)")[0][0] if isinstance(written, str) else written


class _Compiled:
    """A function that is compiled or loaded at its first call, also from other compiled functions.

    Afterwards its name in its module refers to Numba's function, which saves an indirection per call.
    """

    def __init__(self, arguments: tuple[Numba, ...], function: Callable[..., Numba], allocates: bool) -> None:
        self.unloaded = True
        self._arguments = arguments
        self._module, self._name = function.__module__, function.__qualname__
        self._dispatcher = jit(_nrt=allocates, **OPTIONS)(function)
        folder = cache_folder() / _sources(Path(function.__code__.co_filename).parent)
        self._lock = folder / f"{self._module}.{self._name}.lock"
        with suppress(RuntimeError), _caching_in(folder):
            # Raises an error if no folder is writable: each process then compiles for itself.
            self._dispatcher.enable_caching()
        self._call = self._first_call

    def __call__(self, *arguments: Numba) -> Numba:
        return self._call(*arguments)

    @property
    def _numba_type_(self) -> Numba:
        """The type used by Numba where compiled code calls it."""
        return self._dispatcher._numba_type_

    def loaded(self) -> Numba:
        """Return Numba's function."""
        if self.unloaded:
            self._load()
        return self._dispatcher

    def _first_call(self, *arguments: Numba) -> Numba:
        self._load()
        return self._call(*arguments)

    def _load(self) -> None:
        # Processes started together would all compile the same: others wait, and load the result of the first.
        with _without_linear_algebra(), _alone(self._lock), remembered():
            # With types, as compiled callers request it, so both use the same cache entry.
            self._dispatcher.compile(self._arguments)
        self._dispatcher.disable_compile()
        self._call, self.unloaded = self._dispatcher, False
        module = sys.modules.get(self._module)
        if getattr(module, self._name, None) is self:
            setattr(module, self._name, self._dispatcher)


@cache
def _sources(folder: Path) -> str:
    """Return a name for the state of the model's source files, and of those in a folder of this package.

    Numba compiles a function again when its own file changes; inlined functions come from other files. Files of effects
    do not count: their equations are composed into separate files.
    """
    here = Path(__file__).parent
    folders = [here, here / "extended"]
    if folder.is_relative_to(here.parent) and folder not in folders:
        folders.append(folder)
    files = [file for folder in folders for file in sorted(folder.glob("*.py"))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


@contextmanager
def _caching_in(folder: Path) -> Iterator[None]:
    """Make Numba use this cache folder, unless the user has chosen one (NUMBA_CACHE_DIR)."""
    with _ONE_AT_A_TIME:  # the option is global, and modules may be imported by several threads
        before = config.CACHE_DIR
        config.CACHE_DIR = before or str(folder)
        try:
            yield
        finally:
            config.CACHE_DIR = before


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Hold an exclusive lock on a file; without a writable file there is no lock."""
    with ExitStack() as held:
        with suppress(OSError):
            lock.parent.mkdir(parents=True, exist_ok=True)
            fcntl.flock(held.enter_context(lock.open("w")), fcntl.LOCK_EX)
        yield


@contextmanager
def _without_linear_algebra() -> Iterator[None]:
    """Keep Numba from importing SciPy, which is slow, only to check for linear algebra."""
    if LINEAR_ALGEBRA in sys.modules:
        yield
        return
    sys.modules[LINEAR_ALGEBRA] = cast("Any", None)
    try:
        yield
    finally:
        del sys.modules[LINEAR_ALGEBRA]


def select(condition: bool, one: float, other: float) -> float:
    """Return one number if the condition holds, otherwise the other; both are always computed."""
    return one if condition else other


def call(function: Callable[P, None], *arguments: P.args, **named: P.kwargs) -> None:
    """Call a function; in compiled code `function` is its `address`.

    The loops around the equations of effects are thus compiled once, whatever effects there are. Argument types must
    match the signature exactly, which is not checked, and keyword arguments are not allowed.
    """
    function(*arguments, **named)


def _type(context: Numba) -> Numba:
    return lambda _condition, one, other: context.unify_types(one, other)


def _lower(context: Numba, builder: Numba, signature: Numba, values: Numba) -> Numba:
    wanted = (types.boolean, signature.return_type, signature.return_type)
    cast = (context.cast(builder, *each) for each in zip(values, signature.args, wanted, strict=True))
    return builder.select(*cast)


typed(select)(_type)
lowered(select, types.Any, types.Any, types.Any)(_lower)


@typing.infer_global(call)
class _Call(typing.AbstractTemplate):  # type: ignore[misc]
    """Numba's typing template of a call that returns nothing."""

    def generic(self, arguments: Numba, _named: Numba) -> Numba:
        """Return the signature of a call with arguments of these types."""
        return typing.signature(types.none, *arguments)


def _lower_call(context: Numba, builder: Numba, signature: Numba, values: Numba) -> Numba:
    """Generate the call, as Numba does for functions it knows by name."""
    convention, expected = context.call_conv, signature.args[1:]
    kind = convention.get_function_type(types.none, expected)
    function = builder.inttoptr(values[0], kind.as_pointer())
    status, _ = convention.call_function(builder, function, types.none, expected, values[1:])
    with builder.if_then(status.is_error, likely=False):
        convention.return_status_propagate(builder, status)
    return context.get_dummy_value()


lowered(call, kinds.Integer, kinds.VarArg(kinds.Any))(_lower_call)
