"""Hands of a test: a terminal with a keyboard, a gamepad, and a robot that is led by them through real processes."""

import fcntl
import os
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path

from cmr.msg import motor_command_t
from cmr.teleop.gamepad import ABS_X, ABS_Y, BTN_TL, EV_ABS, EV_KEY, EV_SYN, EVENT
from cmr.teleop.keys import ASK, ASK_FLAGS, RELEASES
from tests.support.driver_bench import URL, DriverProcess, Robot, wait_for

FIRST_REPEAT, REPEAT = 0.3, 0.033  # s, of a keyboard
SCREEN = struct.pack("HHHH", 30, 100, 0, 0)
START = "import sys; from cmr.commands import {0}; sys.exit({0}())"


class Terminal:
    """A terminal with a keyboard that answers like one; `reports_releases` as kitty does.

    Keys are typed by a thread, like all that a terminal says: it can hang, and be closed.
    """

    def __init__(self, reports_releases: bool) -> None:
        self.reports_releases = reports_releases
        self.shown = b""
        self.master, self.slave = os.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, SCREEN)
        self._lock = threading.Lock()
        self._key = ""
        self._repeat_due = 0.0
        self._hangs = self._closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def press(self, key: str) -> None:
        """Hold a key down."""
        with self._lock:
            self._key, self._repeat_due = key, time.monotonic() + FIRST_REPEAT
            self._say(f"\x1b[{ord(key)};1:1u" if self.reports_releases else key)

    def release(self) -> float:
        """Let the key go, where nobody reports it right after it was typed again; return when [s]."""
        while not self.reports_releases:
            with self._lock:
                if 0.0 < time.monotonic() + REPEAT - self._repeat_due < 0.5 * REPEAT:
                    self._key = ""
                    return time.monotonic()
            time.sleep(0.001)
        with self._lock:
            self._say(f"\x1b[{ord(self._key)};1:3u")
            self._key = ""
            return time.monotonic()

    def hang(self, hangs: bool = True) -> float:
        """Take nothing any more and say nothing, or go on; return when [s]. The key is still held."""
        with self._lock:
            self._hangs, self._key = hangs, ""
            return time.monotonic()

    def close(self) -> float:
        """Close the window; return when [s]."""
        with self._lock:
            began = time.monotonic()
            if not self._closed:
                self._closed = True
                os.close(self.master)
            return began

    def type(self, text: str) -> None:
        """Say something."""
        with self._lock:
            self._say(text)

    def _say(self, text: str) -> None:
        with suppress(OSError):
            os.write(self.master, text.encode())

    def _run(self) -> None:
        while not self._closed:
            if self._hangs:
                time.sleep(0.002)
                continue
            self._answer(select.select([self.master], [], [], 0.002)[0])
            with self._lock:
                if self._key and not self._closed and time.monotonic() >= self._repeat_due:
                    self._repeat_due = time.monotonic() + REPEAT
                    self._say(f"\x1b[{ord(self._key)};1:2u" if self.reports_releases else self._key)

    def _answer(self, readable: list[int]) -> None:
        with self._lock:
            if self._closed or not readable:
                return
            try:
                said = os.read(self.master, 65536)
            except OSError:  # nobody has it open any more
                time.sleep(0.002)
                return
            self.shown = (self.shown + said)[-100_000:]
            for _ in range(said.count(ASK_FLAGS) * self.reports_releases):
                self._say(f"\x1b[?{RELEASES | 1}u")
            for _ in range(said.count(ASK)):
                self._say("\x1b[0n")


class Pad:
    """A gamepad as a file that holds what the kernel's event device would say."""

    def __init__(self, path: Path) -> None:
        self.path = path
        os.mkfifo(path)
        self._file: int | None = None

    def plug_in(self) -> None:
        """Be there, at rest."""
        wait_for(self._opens)

    def hold(self, held: bool) -> float:
        """Hold the dead-man button, or let it go; return when [s]."""
        return self._say((EV_KEY, BTN_TL, int(held)))

    def move(self, x: int, y: int) -> float:
        """Move the left stick."""
        return self._say((EV_ABS, ABS_X, x), (EV_ABS, ABS_Y, y))

    def unplug(self) -> float:
        """Be gone; return when [s]."""
        now = time.monotonic()
        if self._file is not None:
            os.close(self._file)
            self._file = None
        return now

    def _opens(self) -> bool:
        with suppress(OSError):
            self._file = os.open(self.path, os.O_WRONLY | os.O_NONBLOCK)
        return self._file is not None

    def _say(self, *events: tuple[int, int, int]) -> float:
        assert self._file is not None
        now = time.monotonic()
        os.write(self._file, b"".join(EVENT.pack(0, 0, *event) for event in (*events, (EV_SYN, 0, 0))))
        return now


def start(name: str, *arguments: str) -> list[str]:
    """Return the command line of one of our commands as it is in this checkout."""
    return [sys.executable, "-c", START.format(name), *arguments]


class Led:
    """An emulated robot with its driver, in a world, to be led by processes of cmr-teleop: all real but the robot."""

    def __init__(self, robot: Robot, driver: DriverProcess, folder: Path) -> None:
        self.robot, self.driver, self.folder = robot, driver, folder
        self.commanded: list[tuple[float, bool]] = []  # when which command was heard: whether it asks to move

    def teleop(self, terminal: Terminal | None, *arguments: str) -> "subprocess.Popen[bytes]":
        """Start cmr-teleop, in a terminal or without one."""
        command = start("teleop", "--lcm-url", URL, "--parameters", str(self.folder / "robot_0.yaml"), *arguments)
        if terminal is None:
            return subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE)
        slave = terminal.slave

        def take_terminal() -> None:
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)

        process = subprocess.Popen(
            command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True, preexec_fn=take_terminal
        )
        os.close(slave)
        return process

    def listen(self, seconds: float = 0.005) -> None:
        """Note what is commanded."""
        for received in self.driver.bus.receive(seconds):
            if isinstance(received.message, motor_command_t):
                moves = bool(received.message.left or received.message.right)
                self.commanded.append((time.monotonic(), moves))

    def moves(self) -> bool:
        """Return whether the motors have a duty."""
        return any(self.robot.device.duty)

    def until_moving(self, act: Callable[[], object], seconds: float = 0.2) -> None:
        """Do what moves the robot, and let it move for so long.

        It is done again after two seconds: a key that is pressed while the computer stands still counts as let go.
        """
        for _ in range(10):
            act()
            end = time.monotonic() + 2.0
            self.until(lambda end=end: self.moves() or time.monotonic() > end)  # type: ignore[misc]
            if self.moves():
                break
        assert self.moves(), "it does not move"
        self.wait(seconds)

    def until(self, condition: Callable[[], bool], seconds: float = 30.0) -> None:
        """Listen until something holds."""

        def listened() -> bool:
            self.listen()
            return condition()

        wait_for(listened, seconds)

    def wait(self, seconds: float) -> None:
        """Listen for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.listen()

    def times_to_zero(self, let_go: float) -> tuple[float, float, float, float]:
        """Return how long after `let_go` [s] zero was commanded for good, and the motors had none [s].

        The third is the longest time [s] between two commands meanwhile: they come 50 times a second, unless the
        computer has no time for cmr-teleop, or none to hear it. The fourth is `let_go`.
        """
        self.until(lambda: not self.moves())
        self.wait(0.3)
        moving = [when for when, moves in self.commanded if moves]
        after = [when for when, _ in self.commanded if when > moving[-1]]
        stopped = [when for when, *duties in self.robot.drives if not any(duties)]
        drove = [when for when, *duties in self.robot.drives if any(duties)]
        commanded = after[0] if after else moving[-1]
        heard = [let_go, *(when for when, _ in self.commanded if let_go < when <= commanded), commanded]
        pause = max(later - earlier for earlier, later in pairwise(heard))
        return commanded - let_go, min(t for t in stopped if t > drove[-1]) - let_go, pause, let_go


@contextmanager
def led(folder: Path) -> Iterator[Led]:
    """A robot that stands, its driver and a simulator, ready to be commanded."""
    from cmr.bus.streams import MOTOR_COMMAND
    from tests.support.emulated_drive import NOMINAL

    NOMINAL.save(folder / "robot_0.yaml")
    robot, driver = Robot(folder), DriverProcess(folder)
    driver.bus.subscribe(MOTOR_COMMAND, 0, every=True)
    sim = subprocess.Popen(start("sim", "--parameters", str(folder), "--lcm-url", URL), stderr=subprocess.DEVNULL)
    try:
        yield Led(robot, driver, folder)
    finally:
        sim.terminate()
        sim.wait(20.0)
        driver.end(signal.SIGTERM)
        robot.unplug()
