"""A computer in simulated time: its clock jumps to the next event when all of its threads wait.

The threads are real ones that take turns: only one runs at any time, and it hands over when it waits. Events depend on
times and seeds alone, so the same drive gives the same bytes again.
"""

import errno
import itertools
import math
import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from operator import attrgetter
from random import Random

from robot_driver.emulator.robot_in_time import RobotInTime
from robot_driver.host import Host
from robot_driver.simulated.usb import Lateness, OwnUsb, UsbAdapter

SWITCHED_ON = 1000 * 10**9  # ns; the steady time when the robot is switched on
START_UTIME = 1_800_000_000_000_000  # us; the time of day then
SECOND = 10**9  # ns
NEVER = 2**63
_DUE = attrgetter("due")


class _Thread:
    """A thread of the simulated computer; it waits on `turn` unless it is the running one."""

    def __init__(self, name: str, seed: int) -> None:
        self.turn = threading.Lock()
        self.turn.acquire()
        self.random = Random(f"{seed} {name}")
        self.due = (NEVER, 0)  # when it resumes (ns), and the order among equal times
        self.waits_for: object = None
        self.ended = False


class SimulatedHost(Host):
    """The computer that an emulated robot is plugged into; the thread that creates it is its first.

    The robot is given by `plug_in`, with what is at the other end of each port, by path.
    """

    runs_processes = False

    def __init__(self, seed: int = 0, lateness: Lateness | None = None) -> None:
        self.lateness = lateness or Lateness()
        self._seed = seed
        self._now = SWITCHED_ON
        self._robot: RobotInTime | None = None
        self._lines: dict[str, SimulatedLine] = {}
        self._order = itertools.count(1)
        self._running = _Thread("main", seed)
        self._threads = [self._running]
        self._following = self._running  # the threads that resume first, while time passes
        self._failures: list[BaseException] = []

    def plug_in(self, robot: RobotInTime, adapters: dict[str, UsbAdapter | OwnUsb]) -> None:
        """Provide the ports of `robot` at the paths that name them."""
        self._robot = robot
        self._lines = {name: SimulatedLine(self, name, adapter) for name, adapter in adapters.items()}

    def arrive(self, name: str, data: bytes) -> None:
        """Deliver bytes of the robot to a port."""
        self.follow_robot()
        line = self._lines[name]
        if line.is_open and not line.is_unplugged:
            line.arrived += data
            self.wake(line)

    def unplug(self, name: str) -> None:
        """Pull the cable of a port; its user sees the device vanish."""
        self._lines[name].is_unplugged = True
        self.wake(self._lines[name])

    def plug(self, name: str) -> None:
        """Plug the cable of a port in again."""
        self._lines[name].is_unplugged = False

    def follow_robot(self) -> None:
        """Advance until the robot's current events are done; called before anything here observes it."""
        assert self._robot is not None
        now = SWITCHED_ON + math.ceil(self._robot.now * SECOND)
        if now > self._now:
            self._now = now

    def robot_time(self) -> float:
        """Return the time since the robot was switched on (s)."""
        return (self._now - SWITCHED_ON) / SECOND

    def bring(self, name: str, data: bytes, delay: float) -> None:
        """Put bytes of a port on the wire `delay` (s) from now."""
        assert self._robot is not None
        self._robot.bring(name, data, self.robot_time() + delay)

    def utime_of_robot(self, moment: float) -> int:
        """Return the wall-clock time (us) of a time of the robot (s)."""
        return START_UTIME + round(moment * 1e6)

    def monotonic_ns(self) -> int:
        """Return the monotonic time (ns)."""
        return self._now

    def monotonic(self) -> float:
        """Return the monotonic time (s)."""
        return self._now / SECOND

    def seconds_since_boot(self) -> float:
        """Return the monotonic time (s): this computer is never suspended."""
        return self._now / SECOND

    def utime_at(self, monotonic_nanoseconds: int) -> int:
        """Return the wall-clock time (us) of a monotonic time."""
        return START_UTIME + (monotonic_nanoseconds - SWITCHED_ON) // 1000

    def utime(self) -> int:
        """Return the wall-clock time (us)."""
        return self.utime_at(self._now)

    def sleep(self, seconds: float) -> None:
        """Let the other threads run for this long."""
        self.wait(seconds, None)

    def event(self) -> threading.Event:
        """Return an event with waits in simulated time."""
        return _Event(self)

    def mailbox(self, most: int) -> "_Mailbox":
        """Return a mailbox with waits in simulated time."""
        return _Mailbox(self, most)

    def open_line(self, path: str, baud_rate: int, *, lock_out: bool) -> "SimulatedLine":
        """Open a port of the robot. Raises FileNotFoundError where there is none."""
        del baud_rate, lock_out
        if path not in self._lines or self._lines[path].is_unplugged:
            raise FileNotFoundError(2, "there is no such port", path)
        return self._lines[path].opened()

    def thread(self, work: Callable[[], None], name: str) -> "SimulatedThread":
        """Return a thread, not started yet; it runs when the running ones wait."""
        return SimulatedThread(self, work, name)

    def begin(self, work: Callable[[], None], name: str) -> _Thread:
        """Start a thread."""
        thread = _Thread(f"{name} {next(self._order)}", self._seed)
        thread.due = (self._now, next(self._order))
        self._threads.append(thread)

        def run() -> None:
            _let_others_finish()
            thread.turn.acquire()
            try:
                work()
            except BaseException as failure:  # reported by check()
                self._failures.append(failure)
                self.wake(self)
            finally:
                thread.ended = True
                self._threads.remove(thread)
                self.wake(thread)
                self._running = self._let_happen()
                self._running.turn.release()

        threading.Thread(target=run, name=name, daemon=True).start()
        return thread

    def run(self, seconds: float) -> None:
        """Let the other threads run for this long, or until one of them fails."""
        if not self._failures:
            self.wait(seconds, self)
        self.check()

    def check(self) -> None:
        """Raise the failure that ended a thread, if any."""
        if self._failures:
            raise self._failures[0]

    def wait(self, seconds: float, reason: object) -> None:
        """Make the calling thread wait this long, or until `wake` is called with the same reason."""
        me = self._running
        due = NEVER
        if seconds < math.inf:
            due = self._now + self.lateness.of_waking(me.random)
            if seconds > 0.0:
                due += math.ceil(seconds * SECOND)
        me.due, me.waits_for = (due, next(self._order)), reason
        following = self._let_happen()
        if following is not me:
            self._running = following
            following.turn.release()
            me.turn.acquire()

    def wake(self, reason: object) -> None:
        """Resume the threads that wait for this reason."""
        for thread in self._threads:
            if thread.waits_for is reason:
                due = self._now + self.lateness.of_waking(thread.random)
                thread.due, thread.waits_for = min(thread.due, (due, next(self._order))), None
                if thread.due < self._following.due:
                    self._following = thread
                if self._robot is not None:
                    self._robot.until = min(self._robot.until, (thread.due[0] - SWITCHED_ON) / SECOND)

    def _let_happen(self) -> _Thread:
        """Advance time until a thread resumes; return it."""
        robot = self._robot
        self._following = min(self._threads, key=_DUE)
        while True:
            following, (due, order) = self._following, self._following.due
            if robot is not None:
                robot.let_happen((due - SWITCHED_ON) / SECOND)
            if self._following is not following or following.due[1] != order:
                continue  # a thread was woken meanwhile
            assert due < NEVER, "all threads wait for ever"
            self._now = max(self._now, due)
            following.waits_for = None
            return following


def _let_others_finish() -> None:
    """Prevent this thread from interrupting the one that wakes it, which runs on for a moment: saves every other
    switch.
    """
    with suppress(OSError):
        if os.sched_getscheduler(0) == os.SCHED_OTHER:
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


class SimulatedLine:
    """A port of the simulated computer; `arrived` holds bytes to be read."""

    def __init__(self, host: SimulatedHost, name: str, adapter: UsbAdapter | OwnUsb) -> None:
        self._host = host
        self._name = name
        self._adapter = adapter
        self.arrived = bytearray()
        self.is_open = False
        self.is_unplugged = False

    def opened(self) -> "SimulatedLine":
        """Return this, open and empty."""
        self.arrived.clear()
        self.is_open = True
        return self

    def close(self) -> None:
        """Close the port; bytes that arrive from now on are lost."""
        self.is_open = False

    def write(self, data: bytes) -> None:
        """Send to the robot."""
        self._check()
        self._host.bring(self._name, data, self._adapter.way_down())

    def read(self, most: int, timeout: float) -> bytes:
        """Return what has arrived, up to `most` bytes, as soon as there is any; b"" after `timeout` seconds."""
        self._check()
        arrived = self.arrived
        if not arrived and timeout > 0.0:
            self._host.wait(timeout, self)
            self._check()
        if len(arrived) <= most:
            data = bytes(arrived)
            arrived.clear()
        else:
            data = bytes(arrived[:most])
            del arrived[:most]
        return data

    def _check(self) -> None:
        """Raise OSError if the cable is unplugged."""
        if self.is_unplugged:
            raise OSError(errno.ENODEV, "the device is gone")


class _Event(threading.Event):
    """An event in simulated time."""

    def __init__(self, host: SimulatedHost) -> None:
        super().__init__()
        self._host = host

    def set(self) -> None:
        super().set()
        self._host.wake(self)

    def wait(self, timeout: float | None = None) -> bool:
        if not self.is_set():
            self._host.wait(math.inf if timeout is None else timeout, self)
        return self.is_set()


class _Mailbox:
    """A mailbox in simulated time."""

    def __init__(self, host: SimulatedHost, most: int) -> None:
        self._host = host
        self._most = most
        self._pieces: deque[bytes] = deque()

    def put(self, piece: bytes) -> None:
        if len(self._pieces) < self._most:
            self._pieces.append(piece)
            self._host.wake(self)

    def get(self, timeout: float) -> bytes:
        if not self._pieces and timeout > 0.0:
            self._host.wait(timeout, self)
        return self._pieces.popleft() if self._pieces else b""


class SimulatedThread:
    """A thread of the simulated computer, for the thread that starts it."""

    def __init__(self, host: SimulatedHost, work: Callable[[], None], name: str) -> None:
        self._host = host
        self._work = work
        self._name = name
        self._thread: _Thread | None = None

    def start(self) -> None:
        """Start it."""
        self._thread = self._host.begin(self._work, self._name)

    def join(self, timeout: float | None = None) -> None:
        """Wait until it has ended."""
        if self._thread is not None and not self._thread.ended:
            self._host.wait(math.inf if timeout is None else timeout, self._thread)
