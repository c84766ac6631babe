"""Write files atomically, so that an interrupted command leaves no incomplete ones."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cmr.files import folder_for_results, gone_before_and_after
from cmr.litter import temporary_beside


@contextmanager
def complete_or_none(path: Path) -> Iterator[Path]:
    """Provide the path of a temporary file that replaces `path` in the end; an exception or a signal removes it.

    Raises OSError if the folder cannot be written, KeyboardInterrupt on SIGINT or SIGTERM.
    """
    with _signals_raise():
        temporary = temporary_beside(path)
        try:
            temporary.touch(mode=0o600, exist_ok=False)
            yield temporary
            temporary.chmod(0o644)
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


@contextmanager
def complete_files_or_none(folder: Path) -> Iterator[Path]:
    """Provide a temporary folder whose files are moved into `folder` in the end; an exception or a signal removes it.

    Raises OSError if the folder cannot be created or written, KeyboardInterrupt on SIGINT or SIGTERM.
    """
    with _signals_raise(), folder_for_results(folder):
        temporary = temporary_beside(folder / "partial")
        with gone_before_and_after(temporary):
            temporary.mkdir(mode=0o700)
            yield temporary
            for path in sorted(temporary.iterdir()):
                path.replace(folder / path.name)


@contextmanager
def _signals_raise() -> Iterator[None]:
    """Make SIGINT and SIGTERM raise KeyboardInterrupt, so that the temporary file is removed on exit."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
