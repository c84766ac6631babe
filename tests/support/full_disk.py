"""Files that cannot grow, as on a full disk."""

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def no_file_larger_than(size: int) -> Iterator[None]:
    """Let no file of this process, or of those that it starts, become larger than `size` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def limiting(size: int) -> Callable[[], None]:
    """Return what sets the same limit in a process that is about to start."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
