"""A process that saves a parameter file again and again until it is killed."""

import itertools
import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from cmr.parameters.file import ParameterFile, Value

# What a saver needs is imported once, by the process that all savers are forked from.
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload([__name__])


def save_for_ever(path: Path) -> None:
    """Save version after version; each says in all of its parts which it is."""
    for count in itertools.count(1):
        provenance = {"count": count, "padding": "x" * (count * 997 % 20_000)}
        ParameterFile(0, {"wheel_radius": Value(count * 1e-9 + 0.01)}, provenance=provenance).save(path)


@contextmanager
def saver(path: Path) -> Iterator[ForkServerProcess]:
    """Start one; it is killed in the end."""
    process = CONTEXT.Process(target=save_for_ever, args=(path,))
    process.start()
    try:
        yield process
    finally:
        process.kill()  # SIGKILL, in the middle of whatever it does
        process.join()
