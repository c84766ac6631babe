"""Ask commands many things with one start of Python: each question is answered by a process forked from it.

A command takes half a second to start, most of it to import what all commands import. Here that is done once; what is
forked runs the entry point as the installed command does. What must be the installed command itself (signals, other
modules on the path, what is imported when) is started by itself.
"""

import json
import os
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import distribution
from pathlib import Path

from cmr.distribution import NAME

# The first as a command begins: with one thread, so that this can be forked; the rest is what many commands import.
LOADED = ("cmr.commands", "cmr.bus.bus", "cmr.cli.command_line", "cmr.calibration.calibrator", "cmr.model.fleet")
Answer = subprocess.CompletedProcess[str]


class Commands:
    """All commands, by their names."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process

    def run(self, name: str, *arguments: str, folder: Path | None = None) -> Answer:
        """Run a command to its end, in a folder."""
        asked, answers = self._process.stdin, self._process.stdout
        assert asked is not None
        assert answers is not None
        print(json.dumps([name, arguments, str(folder or Path.cwd())]), file=asked, flush=True)
        code, said, complained = json.loads(answers.readline())
        return Answer([name, *arguments], code, said, complained)


@contextmanager
def commands() -> Iterator[Commands]:
    """Load once what all commands share."""
    environment = {**os.environ, "COLUMNS": "80"}
    command = [sys.executable, "-m", "tests.support.commands"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment) as process:
        yield Commands(process)
        process.stdin.close()  # type: ignore[union-attr]


def answered(name: str, arguments: list[str], folder: str) -> tuple[int, str, str]:
    """Return the exit code of a command, and what it wrote to stdout and to stderr."""
    with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as complained:
        child = os.fork()
        if not child:
            for number, file in ((1, said), (2, complained)):
                os.dup2(file.fileno(), number)
            os.chdir(folder)
            sys.argv = [str(Path(sys.executable).parent / name), *arguments]
            os._exit(_code_of(name))
        _, status = os.waitpid(child, 0)
        texts = []
        for file in (said, complained):
            file.seek(0)
            texts.append(file.read().decode("utf-8"))
    return os.waitstatus_to_exitcode(status), texts[0], texts[1]


def _code_of(name: str) -> int:
    """Run the entry point of a command as its script does; return the exit code."""
    (entry,) = (one for one in distribution(NAME).entry_points if one.name == name and one.group == "console_scripts")
    try:
        code = entry.load()()
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    return code if isinstance(code, int) else int(code is not None)


def main() -> None:
    """Answer questions until there are no more."""
    for module in LOADED:
        import_module(module)
    for line in sys.stdin:
        print(json.dumps(answered(*json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
