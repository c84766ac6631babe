"""The life of a process on the bus: signals, a steady loop, and a report on its health each second."""

import os
import signal
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from types import FrameType, TracebackType
from typing import TypeAlias

from cmr.bus.bus import Bus
from cmr.bus.clock_watch import ClockWatch
from cmr.bus.gate import Gate
from cmr.bus.message import Message
from cmr.bus.messages import Received, make, now_utime
from cmr.bus.streams import PROCESS_STATUS, Stream
from cmr.cli.news import say
from cmr.msg import process_status_t
from cmr.plain_text import plain

LONGEST_WAIT = 0.1  # s; a signal is noticed within this time
# s; messages that arrive meanwhile are handled together: waking up for a message costs more than handling it
NAP = 0.01
STATUS_PERIOD = 1.0  # s
EXIT_INTERRUPTED = 130
LONGEST_MESSAGE = 2_000  # characters of a report, which is sent each second
Outgoing: TypeAlias = tuple[Stream[Message], int | None, Message]  # a message, and the robot whose channel it goes on
SignalHandler: TypeAlias = Callable[[int, FrameType | None], object] | int | None  # as `signal` returns and takes it


class Timer:
    """A periodic timer with `period` [s]; it is due at once the first time."""

    def __init__(self, period: float) -> None:
        self.period = period
        self._due = time.monotonic()

    def due(self) -> bool:
        """Return whether the timer is due; if so, start the next period. Missed periods are not made up."""
        now = time.monotonic()
        if now < self._due:
            return False
        self._due = max(self._due + self.period, now)
        return True


class Process:
    """A process on the bus; use it as a context manager.

    SIGINT and SIGTERM end `loop` at its next turn instead of raising anywhere. The next report contains `state`,
    `message` followed by the result of `remarks`, and `parameters_sha256`. Dispatched messages pass a gate, which
    refuses replayed logs if `lives_now`. Raises BusError on entry when the bus cannot be used.
    """

    def __init__(self, name: str, url: str | None = None, *, lives_now: bool = False) -> None:
        self.name = name
        self.stopped_by_signal = False
        self.state = process_status_t.STARTING
        self.message = ""
        self.remarks: Callable[[], str] = str
        self.problem = ""  # the part of the message that the terminal shows while DEGRADED; empty: all of it
        self.farewell = "stopped"  # last message, sent at exit
        self.parameters_sha256 = ""
        self.overruns = 0
        self._url = url
        self._received: list[Received] = []
        self._published = ""
        self._was_ready = False
        self._turns = 0
        self._clock = ClockWatch()
        self._gate = Gate(replays=not lives_now)
        self._report = Timer(STATUS_PERIOD)
        self._status_sent = time.monotonic()
        self._old_handlers: dict[int, SignalHandler] = {}

    def __enter__(self) -> "Process":
        self.bus = Bus(self._url)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            self._old_handlers[number] = signal.signal(number, self._note_signal)
        self.subscribe, self.publish, self.repeat = self.bus.subscribe, self.bus.publish, self.bus.repeat
        self.publish_status()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.state = process_status_t.STOPPING
        if error is not None:
            self.message, self.remarks = f"{kind.__name__ if kind else ''}: {error}", str
        self.publish_status()
        if error is None:
            self.news(self.farewell)
        for number, handler in self._old_handlers.items():
            signal.signal(number, handler)

    @property
    def exit_code(self) -> int:
        """0 after a normal end, 130 after SIGINT or SIGTERM."""
        return EXIT_INTERRUPTED if self.stopped_by_signal else 0

    def loop(self, rate_hz: float, wait: Callable[[float], object] | None = None) -> Iterator[int]:
        """Yield the time [us] at each turn of a loop at a constant rate, until a signal arrives.

        Between turns it listens to the bus; `received` returns what has arrived. A turn that begins more than one
        period late counts as an overrun, and the lost turns are not made up. A process that must react to another
        source at once does so in `wait(seconds)`, which returns within that time.
        """
        if self.state == process_status_t.STARTING:
            self.state = process_status_t.RUNNING
        period = 1.0 / rate_hz
        due = time.monotonic()
        while not self.stopped_by_signal:
            self._listen_until(due, wait)
            late = time.monotonic() - due
            if late > period:
                self.overruns += 1
                due += late
            due += period
            self._turns += 1
            utime = now_utime()
            was_set = self._clock.look(utime)
            if was_set:
                self.news(was_set)
            self._gate.turn(utime)
            yield utime
            self.bus.publish_repeated()
            if self._report.due():
                self.publish_status()

    def received(self) -> list[Received]:
        """Return the messages that arrived since the last call, oldest first."""
        received, self._received = self._received, []
        return self.bus.latest(received)

    def dispatch(self, handle: Callable[[int, str, Message], object], *, gated: bool = False) -> None:
        """Call `handle(utime, channel, message)` with each message that arrived and passes the gate, oldest first.

        A caller that is `gated` has a gate of its own and receives everything.
        """
        for received in self.received():
            message = received.message if gated else self._gate.let_in(received.channel, received.message)
            if message is not None:
                handle(message.utime, received.channel, message)

    def dispatch_named(self, handle: Callable[[int, str, Message, int | None], object]) -> None:
        """Call `handle(utime, channel, message, sender)` with each message that has arrived, oldest first."""
        for received in self.received():
            handle(received.message.utime, received.channel, received.message, received.sender)

    def publish_all(self, messages: Iterable[Outgoing]) -> None:
        """Send messages given as (stream, robot id or None, message)."""
        for stream, robot_id, message in messages:
            self.publish(stream, message, robot_id)

    def publish_status(self) -> None:
        """Publish `PROCESS_STATUS`: `message`, and any problems with the bus."""
        self._tell_news()
        now = time.monotonic()
        rate = self._turns / max(now - self._status_sent, 1e-6)
        self._turns, self._status_sent = 0, now
        self.publish(
            PROCESS_STATUS,
            make(
                process_status_t,
                utime=now_utime(),
                process=self.name,
                host=socket.gethostname(),
                pid=os.getpid(),
                state=self.state,
                parameters_sha256=self.parameters_sha256,
                loop_rate_hz=rate,
                loop_overruns=float(self.overruns),
                message=self._full_message(),
            ),
        )

    def _full_message(self) -> str:
        sentences = [sentence for sentence in (self.message, self.remarks()) if sentence]
        sentences += [warning for warning in self.bus.warnings if warning not in self.message]
        sentences += [remark for remark in (self._clock.remark(),) if remark]
        counts = chain(self.bus.rejected.items(), self._gate.refused.items())
        rejected = [f"{channel} {why} {count}" for (channel, why), count in counts]
        if rejected:
            sentences.append(f"Messages not taken: {', '.join(rejected)}.")
        unsent = [f"{why} {count}" for why, count in self.bus.unsent.items()]
        if unsent:
            sentences.append(f"Messages not sent: {', '.join(unsent)}.")
        return plain(" ".join(sentences), LONGEST_MESSAGE)

    def news(self, text: str) -> None:
        """Print an event on the terminal, with the time of day."""
        say(self.name, text)

    def _tell_news(self) -> None:
        """Print when the process becomes ready, and each new sentence on a problem or its end."""
        troubled = self.state in (process_status_t.DEGRADED, process_status_t.STARTING)
        problem = (self.problem or self.message) if troubled else ""
        if problem and problem != self._published:
            self.news(problem)
        elif self.state == process_status_t.RUNNING and (self._published or not self._was_ready):
            self.news("ready" if not self._was_ready else "problem over")
            self._was_ready = True
        self._published = problem

    def _listen_until(self, due: float, wait: Callable[[float], object] | None) -> None:
        while not self.stopped_by_signal:
            remaining = max(due - time.monotonic(), 0.0)
            if wait is None:
                time.sleep(min(remaining, NAP))
            else:
                wait(min(remaining, LONGEST_WAIT))
            remaining = due - time.monotonic()
            self._received += self.bus.receive(min(max(remaining, 0.0), LONGEST_WAIT) if wait is None else 0.0)
            if remaining <= 0.0:
                return

    def _note_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.stopped_by_signal = True
