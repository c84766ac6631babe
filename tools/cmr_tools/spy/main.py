"""cmr-spy: the messages on the bus by channel: their rate, jitter, and values.

Usage: cmr-spy
"""

import argparse
import os
import select
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from cmr.bus.messages import now_utime
from cmr.bus.preflight import open_lcm, resolve_url, self_test
from cmr.bus.process import EXIT_INTERRUPTED
from cmr.bus.streams import SELF_TESTS
from cmr.cli.command_line import add_channels, parse_seconds, parser, print_json
from cmr.cli.errors import CommandError
from cmr.cli.stopping import Stopping, stopped_by_signals
from cmr_tools.events import channel_chooser
from cmr_tools.spy.statistics import Statistics
from cmr_tools.spy.view import View, document, table

if TYPE_CHECKING:
    import curses

BETWEEN_SCREENS = 0.5  # s
BETWEEN_DOCUMENTS = 1.0  # s
LONGEST_WAIT = 0.1  # s; a signal is noticed within this time
NO_KEY = -1  # of getch
FIRST_SPECIAL_KEY = 256  # of getch; characters are below
WITHOUT_TERMINAL = 3.0  # s, over which the table is measured if there is no terminal


class Subscriber:
    """Receives everything on a bus and sends nothing, except a test of the bus at the beginning.

    Raises BusError if the bus cannot be used.
    """

    def __init__(self, url: str | None, statistics: Statistics) -> None:
        resolved = resolve_url(url)
        self._lcm = open_lcm(resolved)
        self_test(self._lcm, resolved)
        self._statistics = statistics
        self._lcm.subscribe(".*", self._take).set_queue_capacity(0)  # unlimited
        self._poll = select.poll()
        self._poll.register(self._lcm.fileno(), select.POLLIN)

    def listen(self, until: float, keys: int | None = None) -> bool:
        """Receive until this time of the monotonic clock [s], or until there are keys at the file `keys`."""
        bus = self._lcm.fileno()
        if keys is not None:
            self._poll.register(keys, select.POLLIN)
        while (remaining := until - time.monotonic()) > 0.0:
            for file, _event in self._poll.poll(1e3 * remaining):
                if file != bus:
                    return True
                self._lcm.handle()
        return False

    def _take(self, channel: str, data: bytes) -> None:
        if channel not in SELF_TESTS:
            self._statistics.handle(now_utime(), channel, data)


def main(arguments: list[str]) -> int:
    """Show the messages on a bus, until the key q, or once.

    Raises CommandError if the terminal cannot be used, BusError if the bus cannot be used.
    """
    options = command_parser().parse_args(arguments)
    statistics = Statistics()
    fits = channel_chooser(options.channel)
    with stopped_by_signals() as stopping:
        ear = Subscriber(options.lcm_url, statistics)
        if options.json:
            _print_documents(ear, statistics, fits, options.once, stopping)
        elif options.once is None and sys.stdin.isatty() and sys.stdout.isatty():
            view = View(lambda: statistics.lines(now_utime()), fits)
            _on_terminal(lambda window: _show(window, ear, view, stopping))
        else:
            _listen(ear, WITHOUT_TERMINAL if options.once is None else options.once, stopping)
            print("\n".join(table(statistics.lines(now_utime()), fits)))
    return EXIT_INTERRUPTED if stopping else 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-spy."""
    result = parser(
        "cmr-spy",
        "Show what is said on the bus: each channel with its message type, rate, bytes, age and jitter (standard "
        "deviation of the time from message to message), how many messages were no such messages, and the last "
        "values. Rates are those of the last 5 s.\n\n"
        "Keys: arrows choose a channel and Return shows all of it with units, / asks for a part of the names to show, "
        "space freezes the screen, q quits. Needs a terminal and no display, so it works over ssh.",
        "cmr-spy --channel 'MOTOR_*' --channel 'POSE_*'\n  cmr-spy --once 5 > table.txt\n  cmr-spy --json | jq .",
    )
    result.add_argument(
        "--json", action="store_true", help="print a line of JSON each second, for programs; with --once, one line"
    )
    result.add_argument(
        "--once",
        type=parse_seconds,
        metavar="S",
        help=f"listen for so long, print the table and end; without a terminal that is done anyway, "
        f"after {WITHOUT_TERMINAL:g} s",
    )
    add_channels(result)
    return result


def _print_documents(
    ear: Subscriber, statistics: Statistics, fits: Callable[[str], bool], once: float | None, stopping: Stopping
) -> None:
    """Print a line of JSON after each second until a signal arrives, or one after `once` seconds."""
    while not stopping:
        _listen(ear, BETWEEN_DOCUMENTS if once is None else once, stopping)
        now = now_utime()
        print_json(document(now, statistics.lines(now), fits), indent=None)
        if once is not None:
            return


def _listen(ear: Subscriber, seconds: float, stopping: Stopping) -> None:
    end = time.monotonic() + seconds
    while not stopping and (now := time.monotonic()) < end:
        ear.listen(min(end, now + LONGEST_WAIT))


def _on_terminal(work: "Callable[[curses.window], None]") -> None:
    """Call `work` with the whole terminal as a window; restore the terminal afterwards."""
    import curses

    os.environ.setdefault("ESCDELAY", "25")  # ms until Escape is taken for itself; ncurses would wait for a second
    try:
        curses.wrapper(work)
    except curses.error as error:
        raise CommandError(f"This terminal cannot show it ({error}). Set TERM, or use --once S.") from error


def _show(window: "curses.window", ear: Subscriber, view: View, stopping: Stopping) -> None:
    """Show the view; draw it twice a second and after each key."""
    import curses

    with suppress(curses.error):  # a terminal that cannot hide its cursor
        curses.curs_set(0)
    window.nodelay(True)
    names = {
        curses.KEY_UP: "up",
        curses.KEY_DOWN: "down",
        curses.KEY_LEFT: "left",
        curses.KEY_RIGHT: "right",
        curses.KEY_ENTER: "\n",
        curses.KEY_BACKSPACE: "\x7f",
    }
    due = 0.0
    while not (stopping or view.quit):
        now = time.monotonic()
        if now >= due:
            due = now + BETWEEN_SCREENS
            _draw(window, view)
        ear.listen(min(due, now + LONGEST_WAIT), sys.stdin.fileno())
        while (code := window.getch()) != NO_KEY:
            view.press(names.get(code) or (chr(code) if code < FIRST_SPECIAL_KEY else ""))
            due = 0.0


def _draw(window: "curses.window", view: View) -> None:
    import curses

    height, width = window.getmaxyx()
    window.erase()
    for place, row in enumerate(view.screen(height, width - 1)):
        window.addnstr(place, 0, row.text, width - 1, curses.A_REVERSE if row.chosen else curses.A_NORMAL)
    window.refresh()
