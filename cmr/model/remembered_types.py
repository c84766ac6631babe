"""What Numba finds out again and again while it compiles, found out once: up to a third of the time it takes.

For each sum and product in a function Numba tries a dozen kinds of operands, in several rounds, although the types of
the operands alone decide. A function that is inlined is analysed and copied at each place. `remembered` keeps those
answers while something is compiled. What is compiled is the same to the bit; only other versions of Numba, in which
these functions are called otherwise, compile without it.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from typing import Any, TypeAlias

from numba.core import inline_closurecall, ir, targetconfig, types

# Numba has annotations from some version on; this way they make no difference.
Numba: TypeAlias = Any
kinds: Numba = types
inlining: Numba = inline_closurecall
representation: Numba = ir
flags_in_force: Numba = targetconfig.ConfigStack.top_or_none
Answers: TypeAlias = dict[tuple[Numba, ...], Numba]


class _Memory(threading.local):
    """What this thread remembers; nothing while it compiles nothing of ours."""

    def __init__(self) -> None:
        self.depth = 0
        self.types: Answers = {}
        self.analysed: Answers = {}


_MEMORY = _Memory()


@contextmanager
def remembered() -> Iterator[None]:
    """Let Numba remember, in this thread, what it finds out; it forgets all at the end of the outermost one."""
    _install()
    _MEMORY.depth += 1
    try:
        yield
    finally:
        _MEMORY.depth -= 1
        if not _MEMORY.depth:
            _MEMORY.types, _MEMORY.analysed = {}, {}


@cache
def _install() -> None:
    """Put what remembers in the place of Numba's functions, each of which it calls; it does so only once."""
    for owner, name, remembering in (
        (kinds.functions.BaseFunction, "get_call_type", _remember_types),
        (inlining.InlineWorker, "run_untyped_passes", _remember_analysis),
    ):
        original: Numba = getattr(owner, name, None)
        if original is not None:
            setattr(owner, name, wraps(original)(remembering(original)))
    if not hasattr(representation.Loc, "__deepcopy__"):
        # A place in a source file never changes; copies of it are half of what it takes to copy a function.
        representation.Loc.__deepcopy__ = lambda place, _copied: place


def _remember_types(find: Callable[..., Numba]) -> Callable[..., Numba]:
    """Return a function that finds the type of a call of one of Numba's functions with arguments of these types."""

    def find_once(function: Numba, context: Numba, arguments: tuple[Numba, ...], named: Numba) -> Numba:
        if not _MEMORY.depth or named:
            return find(function, context, arguments, named)
        flags = flags_in_force()
        key = (id(function), id(context), id(flags), tuple(arguments))
        if key not in _MEMORY.types:
            # The objects are kept with the answer: no other ones can have the same numbers meanwhile.
            _MEMORY.types[key] = find(function, context, arguments, named), function, context, flags
        return _MEMORY.types[key][0]

    return find_once


def _remember_analysis(analyse: Callable[..., Numba]) -> Callable[..., Numba]:
    """Return a function that analyses a function which is to be inlined; whoever inlines it copies the result."""

    def analyse_once(worker: Numba, function: Numba, enable_ssa: bool = False) -> Numba:
        if not _MEMORY.depth:
            return analyse(worker, function, enable_ssa)
        key = (function, enable_ssa)
        if key not in _MEMORY.analysed:
            _MEMORY.analysed[key] = analyse(worker, function, enable_ssa)
        worker.flags.enable_ssa = enable_ssa  # as the analysis leaves it
        return _MEMORY.analysed[key]

    return analyse_once
