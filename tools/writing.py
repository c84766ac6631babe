"""Write files so that an interrupted command leaves no half ones."""

import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cmr.files import folder_for_results


@contextmanager
def complete_or_none(path: Path) -> Iterator[Path]:
    """Give the path of a temporary file that replaces `path` in the end; an exception or a signal removes it.

    Raises OSError when the folder cannot be written, KeyboardInterrupt on SIGINT or SIGTERM.
    """
    with _signals_raise():
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        os.close(descriptor)
        temporary = Path(name)
        try:
            yield temporary
            temporary.chmod(0o644)  # mkstemp makes it private
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


@contextmanager
def complete_files_or_none(folder: Path) -> Iterator[Path]:
    """Give a temporary folder whose files are moved into `folder` in the end; an exception or a signal removes it.

    Raises OSError when the folder cannot be made or written, KeyboardInterrupt on SIGINT or SIGTERM.
    """
    with (
        _signals_raise(),
        folder_for_results(folder),
        tempfile.TemporaryDirectory(prefix=".partial.", dir=folder) as name,
    ):
        yield Path(name)
        for path in sorted(Path(name).iterdir()):
            path.replace(folder / path.name)


@contextmanager
def _signals_raise() -> Iterator[None]:
    """Let SIGINT and SIGTERM raise KeyboardInterrupt, so that the temporary file is removed on the way out."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
