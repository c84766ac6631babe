"""A life of a process inside the fuzzer: its own main on a stepped bus and clock, from its start to its end."""

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
from fuzzing.programs import ANYTHING, PARAMETERS, URL, Program, Stage
from fuzzing.stepped_bus import Network
from fuzzing.stepped_time import Ended, PlainClock, SteppedTime

LONGEST = 0.5  # s of a processor that a process may spend on what came within a tenth of a second
PATIENCE = 60.0  # s, real, until it counts as hanging without using a processor
START_UP = 600.0  # s, real
BEGINNING, ENDING = 1.0, 5.0  # s of stepped time
FRAMES = 6  # of a traceback that are shown


class Finding(NamedTuple):
    """Something that must not be: of which kind, where in the code, and what was seen."""

    kind: str
    where: str
    text: str


class Life:
    """One life. `found` is what was wrong; `is_over` says that the process has ended, as it may, or not."""

    def __init__(self, program: Program, folder: Path, key: Path | None) -> None:
        self.found: list[Finding] = []
        self.is_over = False
        self.longest = 0.0  # s of a processor in one step
        self.refused_publications = 0
        self._program, self._folder = program, folder
        (folder / "robot_0.yaml").write_text(PARAMETERS.read_text())
        os.environ.pop("CMR_KEY", None)
        if key is not None:
            os.environ["CMR_KEY"] = str(key)
        self.stage = Stage(folder)
        program.prepare(self.stage)
        self.time = SteppedTime(self.stage.clock)
        self.network = Network(self.time.sleep)
        self._handlers: dict[int, Callable[[int, None], object]] = {}
        self._ended_with: BaseException | int | None = None
        self._thread = threading.Thread(target=self._live, name="fuzzed", daemon=True)

    def begin(self) -> None:
        """Let it begin, and come to rest in its loop."""
        self._main: Any = importlib.import_module(self._program.module).main
        self.take_over()
        self._thread.start()
        self._step(BEGINNING, START_UP)
        self.longest = 0.0
        self.take_over()

    def take_over(self) -> None:
        """Put bus, clock and signals in place of the system's; also in what was imported since."""
        self.time.take_over()
        preflight: Any = importlib.import_module("cmr.bus.preflight")
        preflight.lcm = self.network
        system: dict[str, Any] = {"signal": signal, "warnings": warnings, "threading": threading}
        system["signal"].signal = self._note_handler
        system["warnings"].showwarning = self._note_warning
        system["threading"].excepthook = self._note_failed_thread

    @property
    def utime(self) -> int:
        """The time of day [us]."""
        return self.stage.clock.utime()

    def set_clock(self, offset: int) -> None:
        """Set the time of day by so much [us], where the clock can be set."""
        if isinstance(self.stage.clock, PlainClock):
            self.stage.clock.offset += offset

    def bring(self, channel: str, data: bytes) -> None:
        """Have a message arrive."""
        if self.stage.duties is not None:
            self.stage.duties.sent(channel, data, self.stage.clock.monotonic_ns() // 1000)
        self.network.bring(self._program.url, channel, data)

    def advance(self, seconds: float) -> None:
        """Let it live on for so long, in steps of a tenth of a second, and look at what it does."""
        while seconds > 0.0 and not self.is_over:
            step = min(seconds, 0.1)
            seconds -= step
            cost = self._step(step, PATIENCE)
            self.longest = max(self.longest, cost)
            if cost > LONGEST:
                self._find("hang", self._where(), f"{cost:.2f} s of a processor in a step of {step:.3f} s")
            self._check()

    def end(self) -> None:
        """Send SIGTERM unless it has ended by itself, and see it end."""
        if not self.is_over:
            self._terminate()
        self.network.close()

    def _terminate(self) -> None:
        handler = self._handlers.get(signal.SIGTERM)
        if handler is not None:
            handler(signal.SIGTERM, None)
        end = self.time.monotonic() + ENDING
        self._ending = True
        while not self.is_over and self.time.monotonic() < end:
            self._step(0.1, PATIENCE)
        if not self.is_over:
            self._find("does not end", self._where(), f"{ENDING} s after SIGTERM")
            self.time.end()
            self._thread.join(PATIENCE)

    _ending = False

    def heard(self) -> dict[str, Stream[Any]]:
        """Return the streams that the process subscribed to on the bus that is fuzzed, by name."""
        found = {}
        for url, pattern in self.network.subscribed:
            if url != self._program.url or pattern.startswith("CMR_SELF"):
                continue
            for stream in STREAMS:
                name = stream.channel(0 if stream.per_robot else None)
                if re.fullmatch(pattern, name):
                    found[stream.name] = stream
        return found

    def _live(self) -> None:
        """Be the process, in a thread of its own."""
        self.time.lead_this_thread()
        try:
            self._ended_with = self._main([*self._program.arguments(self._folder), *self._url()])
        except (Exception, SystemExit, KeyboardInterrupt, Ended) as error:
            self._ended_with = error
        self.is_over = True
        self.time.hand_over()

    def _url(self) -> list[str]:
        return ["--lcm-url", URL]

    def _step(self, seconds: float, patience: float) -> float:
        """Let it go on for so long; return what that took [s of a processor]."""
        clock = time.pthread_getcpuclockid(self._thread.ident or 0)
        before = time.clock_gettime(clock)
        if not self.time.run(seconds, patience):
            self._find("hang", self._where(), f"no rest within {patience:.0f} s")
            self.is_over = True
            return 0.0
        if self.is_over:
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
            self._find("death", *_described(ended))
        else:
            self._find("death", "", f"ended with {ended}")

    def _check(self) -> None:
        """Look at what it published, and at what its motors do."""
        while self.network.published:
            channel, data = self.network.published.popleft()
            if self._program.relays:
                continue
            problem = wrong_in(channel, data)
            if problem:
                self._find("publication", channel, problem)
        if self.stage.duties is not None:
            problem = self.stage.duties.problem(self.stage.clock.monotonic_ns() // 1000)
            if problem:
                self._find("duty", "", problem)

    def _find(self, kind: str, where: str, text: str) -> None:
        self.found.append(Finding(kind, where, text[:2000]))

    def _where(self) -> str:
        """Return where the process is."""
        frame = sys._current_frames().get(self._thread.ident or 0)
        places = [f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_stack(frame)] if frame else []
        return " ".join(places[-FRAMES:])

    def _note_handler(self, number: int, handler: Callable[[int, None], object]) -> object:
        before, self._handlers[number] = self._handlers.get(number), handler
        return before

    def _note_warning(self, message: Any, category: type[Warning], filename: str, line: int, *_more: object) -> None:
        if issubclass(category, RuntimeWarning):
            self._find("warning", f"{Path(filename).name}:{line}", str(message))

    def _note_failed_thread(self, failed: Any) -> None:
        self._find("death", *_described(failed.exc_value))


def wrong_in(channel: str, data: bytes) -> str:
    """Return what is wrong with a message that a process published; empty if nothing is."""
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
    """Return where an exception was raised, and all that is known of it."""
    places = traceback.extract_tb(error.__traceback__)
    ours = [f"{Path(place.filename).name}:{place.lineno}" for place in places]
    return " ".join(ours[-FRAMES:]), "".join(traceback.format_exception(error))[-2000:]
