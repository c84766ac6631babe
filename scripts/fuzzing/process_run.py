"""Run a process inside the fuzzer, from start to end: its own main() on an in-memory bus and a stepped clock."""

import importlib
import os
import re
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.possible import BOUNDS, screened
from cmr.bus.signing import without_signature
from cmr.bus.streams import STREAMS, Stream
from cmr.cli.errors import ExpectedError
from cmr.msg import motor_feedback_t
from fuzzing.programs import ANYTHING, PARAMETERS, URL, Program, Testbed
from fuzzing.stepped_bus import Network
from fuzzing.stepped_time import ForcedEnd, PlainClock, SteppedTime

LONGEST = 0.5  # s of CPU time for handling what arrives within 0.1 s
HANG_TIMEOUT = 60.0  # s of real time until a process counts as hanging, even if it uses no CPU time
START_TIMEOUT = 600.0  # s of real time
BEGINNING, ENDING = 1.0, 5.0  # s of stepped time
FRAMES = 6  # of a traceback, shown in a finding


class Finding(NamedTuple):
    """A problem: its kind, its place in the code, and a description."""

    kind: str
    where: str
    text: str


class ProcessRun:
    """One run of a process. `found` lists its findings; `has_ended` is set when the process ends."""

    def __init__(self, program: Program, folder: Path, key: Path | None) -> None:
        self.found: list[Finding] = []
        self.has_ended = False
        self.longest = 0.0  # s of CPU time in one step
        self.refused_publications = 0
        self._program, self._folder = program, folder
        (folder / "robot_0.yaml").write_text(PARAMETERS.read_text())
        os.environ.pop("CMR_KEY", None)
        if key is not None:
            os.environ["CMR_KEY"] = str(key)
        self.testbed = Testbed(folder)
        program.prepare(self.testbed)
        self.time = SteppedTime(self.testbed.clock)
        self.network = Network(self.time.sleep)
        self._handlers: dict[int, Callable[[int, None], object]] = {}
        self._ended_with: BaseException | int | None = None
        self._thread = threading.Thread(target=self._run_main, name="fuzzed", daemon=True)

    def begin(self) -> None:
        """Start the process, and advance time until it is in its loop."""
        self._main: Any = importlib.import_module(self._program.module).main
        self.install()
        self._thread.start()
        self._step(BEGINNING, START_TIMEOUT)
        self.longest = 0.0
        self.install()

    def install(self) -> None:
        """Replace the system's bus, clock and signals, also in modules imported since the last call."""
        self.time.install()
        preflight: Any = importlib.import_module("cmr.bus.preflight")
        preflight.lcm = self.network
        system: dict[str, Any] = {"signal": signal, "warnings": warnings, "threading": threading}
        system["signal"].signal = self._note_handler
        system["warnings"].showwarning = self._note_warning
        system["threading"].excepthook = self._note_failed_thread

    @property
    def utime(self) -> int:
        """The stepped time of day [us]."""
        return self.testbed.clock.utime()

    def set_clock(self, offset: int) -> None:
        """Shift the time of day by `offset` [us], if the clock can be set."""
        if isinstance(self.testbed.clock, PlainClock):
            self.testbed.clock.offset += offset

    def deliver(self, channel: str, data: bytes) -> None:
        """Deliver a message to the process."""
        if self.testbed.duties is not None:
            self.testbed.duties.sent(channel, data, self.testbed.clock.monotonic_ns() // 1000)
        self.network.deliver(self._program.url, channel, data)

    def advance(self, seconds: float) -> None:
        """Advance time by `seconds`, in steps of at most 0.1 s, and check the process after each step."""
        while seconds > 0.0 and not self.has_ended:
            step = min(seconds, 0.1)
            seconds -= step
            cost = self._step(step, HANG_TIMEOUT)
            self.longest = max(self.longest, cost)
            if cost > LONGEST:
                self.report_finding("hang", self._location(), f"{cost:.2f} s of CPU time in a step of {step:.3f} s")
            self._check()

    def end(self) -> None:
        """Send SIGTERM unless the process has already ended, and check that it ends."""
        if not self.has_ended:
            self._terminate()
        self.network.close()

    def _terminate(self) -> None:
        handler = self._handlers.get(signal.SIGTERM)
        if handler is not None:
            handler(signal.SIGTERM, None)
        end = self.time.monotonic() + ENDING
        self._ending = True
        while not self.has_ended and self.time.monotonic() < end:
            self._step(0.1, HANG_TIMEOUT)
        if not self.has_ended:
            self.report_finding("does not end", self._location(), f"{ENDING} s after SIGTERM")
            self.time.end()
            self._thread.join(HANG_TIMEOUT)

    _ending = False

    def subscribed_streams(self) -> dict[str, Stream[Any]]:
        """Return the streams that the process subscribed to on the fuzzed bus, by name."""
        found = {}
        for url, pattern in self.network.subscribed:
            if url != self._program.url or pattern.startswith("CMR_SELF"):
                continue
            for stream in STREAMS:
                name = stream.channel(0 if stream.per_robot else None)
                if re.fullmatch(pattern, name):
                    found[stream.name] = stream
        return found

    def _run_main(self) -> None:
        """Run main() of the process; the body of its thread."""
        self.time.control_this_thread()
        try:
            self._ended_with = self._main([*self._program.arguments(self._folder), *self._url()])
        except (Exception, SystemExit, KeyboardInterrupt, ForcedEnd) as error:
            self._ended_with = error
        self.has_ended = True
        self.time.yield_control()

    def _url(self) -> list[str]:
        return ["--lcm-url", URL]

    def _step(self, seconds: float, timeout: float) -> float:
        """Advance time by `seconds`; return the CPU time used [s]. `timeout` is real time [s]."""
        clock = time.pthread_getcpuclockid(self._thread.ident or 0)
        before = time.clock_gettime(clock)
        if not self.time.run(seconds, timeout):
            self.report_finding("hang", self._location(), f"no rest within {timeout:.0f} s")
            self.has_ended = True
            return 0.0
        if self.has_ended:
            self._judge_end()
            return 0.0
        return time.clock_gettime(clock) - before

    def _judge_end(self) -> None:
        ended = self._ended_with
        if self._ending and (isinstance(ended, (int, ExpectedError, SystemExit))):
            return
        may_end = self._program.may_end
        is_orderly = isinstance(ended, (ExpectedError, SystemExit, int))
        if (
            is_orderly
            and may_end is not None
            and (may_end == ANYTHING or may_end in str(ended) or isinstance(ended, int))
        ):
            return
        if isinstance(ended, BaseException):
            self.report_finding("death", *_described(ended))
        else:
            self.report_finding("death", "", f"ended with {ended}")

    def _check(self) -> None:
        """Check the messages that the process published, and the duties of its motors."""
        while self.network.published:
            channel, data = self.network.published.popleft()
            if self._program.relays:
                continue
            problem = problem_in(channel, data)
            if problem:
                self.report_finding("publication", channel, problem)
        if self.testbed.duties is not None:
            problem = self.testbed.duties.problem(self.testbed.clock.monotonic_ns() // 1000)
            if problem:
                self.report_finding("duty", "", problem)

    def report_finding(self, kind: str, where: str, text: str) -> None:
        """Add a finding, with its text shortened to 2,000 characters."""
        self.found.append(Finding(kind, where, text[:2000]))

    def _location(self) -> str:
        """Return the innermost frames of the process's thread, as file:line."""
        frame = sys._current_frames().get(self._thread.ident or 0)
        places = [f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_stack(frame)] if frame else []
        return " ".join(places[-FRAMES:])

    def _note_handler(self, number: int, handler: Callable[[int, None], object]) -> object:
        before, self._handlers[number] = self._handlers.get(number), handler
        return before

    def _note_warning(self, message: Any, category: type[Warning], filename: str, line: int, *_more: object) -> None:
        if issubclass(category, RuntimeWarning):
            self.report_finding("warning", f"{Path(filename).name}:{line}", str(message))

    def _note_failed_thread(self, failed: Any) -> None:
        self.report_finding("death", *_described(failed.exc_value))


def problem_in(channel: str, data: bytes) -> str:
    """Return the problem with a message that a process published; empty if there is none."""
    if channel.startswith("CMR_SELF"):
        return ""
    try:
        message = decode(channel, without_signature(data)).message
    except RejectedMessage as rejected:
        return str(rejected)
    if type(message) not in BOUNDS or isinstance(message, motor_feedback_t):
        return ""
    return ", ".join(screened(message).reasons)


def _described(error: BaseException) -> tuple[str, str]:
    """Return the place where an exception was raised, and its traceback."""
    places = traceback.extract_tb(error.__traceback__)
    ours = [f"{Path(place.filename).name}:{place.lineno}" for place in places]
    return " ".join(ours[-FRAMES:]), "".join(traceback.format_exception(error))[-2000:]
