"""Finished runs, one line each, so that an interrupted sweep can be resumed."""

import fcntl
import json
import os
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TypeAlias

from cmr.files import folder_for_results

Result: TypeAlias = dict[str, float | str | bool | None]  # numbers and texts by name


class JournalError(Exception):
    """The journal cannot be used; the text gives the reason and the remedy."""


class Journal:
    """Results of runs in a file, by key; a context manager that locks the file.

    Lines are atomic: an incomplete last line after a crash is removed on entry. Raises JournalError on entry when
    another process uses the file, or a line is invalid.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.results: dict[str, Result] = {}
        self._made = ExitStack()

    def __enter__(self) -> "Journal":
        self._made.enter_context(folder_for_results(self.path.parent))
        self._stream = self.path.open("a+b")
        try:
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._read()
        except BlockingIOError as error:
            self._close()
            raise JournalError(
                f"{self.path} is in use by another cmr-sweep. Wait for it, or choose another --out."
            ) from error
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if self._stream.tell() == 0:
            self.path.unlink(missing_ok=True)  # no run was finished
        self._close()

    def _close(self) -> None:
        self._stream.close()
        self._made.close()

    def add(self, key: str, result: Mapping[str, float | str | bool | None]) -> None:
        """Store the result of a run; an existing one is kept."""
        if key in self.results:
            return
        self.results[key] = dict(result)
        self._stream.write(json.dumps({"key": key, "result": self.results[key]}).encode() + b"\n")
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def _read(self) -> None:
        self._stream.seek(0)
        text = self._stream.read()
        whole = text.rfind(b"\n") + 1
        self._stream.truncate(whole)
        for number, line in enumerate(text[:whole].splitlines(), start=1):
            try:
                entry = json.loads(line)
                self.results.setdefault(str(entry["key"]), dict(entry["result"]))
            except (ValueError, KeyError, TypeError) as error:
                raise JournalError(
                    f"{self.path}, line {number}: is no result of a run. Choose another --out, or delete the file."
                ) from error
