"""Write an event log so that an interrupted command leaves no half file."""

import os
import signal
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import lcm

from cmr.files import folder_for_results
from cmr.tools.converting import Event


def write_log(path: Path, events: Iterable[Event], robot_id: int) -> None:
    """Write the messages as an LCM event log, each logged at its own utime, in the order given.

    The log appears under its name when it is complete, in place of one that was there. Raises OSError when the
    folder cannot be written, KeyboardInterrupt on SIGINT or SIGTERM.
    """
    with complete_or_none(path) as temporary:
        log = lcm.EventLog(str(temporary), "w", overwrite=True)
        try:
            for event in events:
                channel = event.stream.channel(robot_id)
                log.write_event(event.message.utime, channel, event.message.encode())
        finally:
            log.close()


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
