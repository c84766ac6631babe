"""What this process has taken of the system, to see whether it gives it back."""

from pathlib import Path


def threads() -> int:
    """Return how many threads this process has, also those that Python knows nothing of."""
    return len(list(Path("/proc/self/task").iterdir()))


def open_files() -> int:
    """Return how many files and sockets this process has open."""
    return len(list(Path("/proc/self/fd").iterdir()))
