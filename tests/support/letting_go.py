"""Ways to let go of a robot that is led by hand: how long it takes until it is commanded zero, and its motors are."""

import json
import os
import re
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import NamedTuple

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.support.driver_bench import URL
from tests.support.hands import Led, Pad, Terminal, start

TOKEN = "a secret of the test"
LIMIT = 0.2  # s until zero is commanded
STARTED = 180.0  # s for a process to be ready, on a slow machine
HELD = 0.15  # s for which the robot moves, before it is let go


class Trial(NamedTuple):
    """How a robot was let go, and how long it took until zero was commanded, and until the motors had none [s].

    `let_go` is when [s]; `pause` is the longest time between two commands meanwhile [s].
    """

    kind: str
    commanded: float
    motors: float
    pause: float
    let_go: float


class Page:
    """A page with the joystick, without a browser: it answers each beat with where the joystick is."""

    def __init__(self, port: int, robot_id: int) -> None:
        self.forward = 0.0
        self.beats = 0
        self._answers = True
        self._connection: ClientConnection = connect(f"ws://127.0.0.1:{port}/drive/hands", compression=None)
        self._say(token=TOKEN)
        self._connection.recv(10.0)
        self._say(robot=robot_id, take_over=True)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def let_go(self) -> float:
        """Let the joystick go; return when [s]. The page says so at once."""
        self.forward = 0.0
        return time.monotonic()

    def push(self) -> None:
        """Push the joystick ahead, and answer."""
        self._answers, self.forward = True, 1.0

    def fall_silent(self) -> float:
        """Say nothing any more; return when [s]."""
        self._answers = False
        return time.monotonic()

    def close(self) -> float:
        """Close the page; return when [s]."""
        began = time.monotonic()
        self._answers = False
        self._connection.close()
        return began

    def _say(self, **what: object) -> None:
        self._connection.send(json.dumps(what))

    def _run(self) -> None:
        with suppress(ConnectionClosed, OSError):
            while True:
                told = json.loads(self._connection.recv())
                self.beats += 1
                if self._answers and "beat" in told:
                    self._say(beat=told["beat"], forward=self.forward)


@contextmanager
def in_terminal(led: Led, reports_releases: bool) -> Iterator[Terminal]:
    """A terminal in which cmr-teleop is ready to drive."""
    terminal = Terminal(reports_releases)
    process = led.teleop(terminal)
    try:
        led.until(lambda: b"ready" in terminal.shown, STARTED)
        led.wait(0.5)
        yield terminal
    finally:
        terminal.close()
        process.wait(20.0)


@contextmanager
def with_pad(led: Led) -> Iterator[Pad]:
    """A gamepad with which cmr-teleop is ready to drive."""
    pad = Pad(led.folder / f"pad{time.monotonic_ns()}")
    process = led.teleop(None, "--gamepad", str(pad.path))
    try:
        pad.plug_in()
        pad.move(0, -20_000)
        yield pad
    finally:
        process.terminate()
        process.communicate(timeout=20.0)


@contextmanager
def pages(led: Led) -> Iterator[Callable[[], Page]]:
    """A server of pages; returns what opens one that is ready to drive."""
    command = start("view", "--lcm-url", URL, "--port", "18200", "--token", TOKEN)
    environment = {**os.environ, "CMR_PARAMETERS": str(led.folder)}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as view:
        assert view.stderr is not None
        found = re.search(r":(\d+) ", view.stderr.readline())
        threading.Thread(target=view.stderr.read, daemon=True).start()
        assert found is not None

        def opened() -> Page:
            page = Page(int(found[1]), 0)
            led.until(lambda: page.beats > 0, STARTED)
            return page

        try:
            yield opened
        finally:
            view.terminate()


def of_terminal(led: Led, reports_releases: bool, number: int) -> Iterator[Trial]:
    """Let keys go, and have the terminal hang."""
    with in_terminal(led, reports_releases) as terminal:
        which = "releases reported" if reports_releases else "no releases reported"
        for _ in range(number):
            led.until_moving(lambda: terminal.press("w"), HELD)
            yield Trial(f"key released, {which}", *led.times_to_zero(terminal.release()))
            led.until_moving(lambda: terminal.press("w"), HELD)
            yield Trial(f"terminal hung, {which}", *led.times_to_zero(terminal.hang()))
            terminal.hang(False)
            led.wait(0.2)


def of_closing(led: Led, number: int) -> Iterator[Trial]:
    """Close the terminal's window while a key is held."""
    for k in range(number):
        with in_terminal(led, reports_releases=k % 2 == 0) as terminal:
            led.until_moving(lambda: terminal.press("w"), HELD)
            yield Trial("terminal closed", *led.times_to_zero(terminal.close()))


def of_pad(led: Led, number: int) -> Iterator[Trial]:
    """Let the dead-man button go, and unplug the gamepad."""
    with with_pad(led) as pad:
        for _ in range(number):
            led.until_moving(lambda: pad.hold(True), HELD)
            yield Trial("dead-man button released", *led.times_to_zero(pad.hold(False)))
            led.until_moving(lambda: pad.hold(True), HELD)
            yield Trial("gamepad unplugged", *led.times_to_zero(pad.unplug()))
            pad.plug_in()
            pad.move(0, -20_000)


def of_page(led: Led, number: int, open_page: Callable[[], Page]) -> Iterator[Trial]:
    """Let the joystick go, hide the page, and close it."""
    for _ in range(number):
        page = open_page()
        for act, kind in ((page.let_go, "joystick released"), (page.fall_silent, "page hidden or silent")):
            led.until_moving(page.push, HELD)
            yield Trial(kind, *led.times_to_zero(act()))
        led.until_moving(page.push, HELD)
        yield Trial("page closed", *led.times_to_zero(page.close()))


def all_ways(led: Led, number: int) -> Iterator[Trial]:
    """Let go in each way so many times."""
    for reports_releases in (True, False):
        yield from of_terminal(led, reports_releases, number)
    yield from of_closing(led, number)
    yield from of_pad(led, number)
    with ExitStack() as stack:
        yield from of_page(led, number, stack.enter_context(pages(led)))
