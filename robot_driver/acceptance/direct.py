"""Steps without a filter: the driver on the port itself, a second driver, and faults that need a person's hands."""

import errno
import fcntl
import os
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from cmr.msg import process_status_t
from robot_driver.acceptance import stops
from robot_driver.acceptance.findings import Finding, milliseconds
from robot_driver.acceptance.judges import HELD_UP
from robot_driver.acceptance.record import Record, Span
from robot_driver.acceptance.running import RATE, SETTLING, Run
from robot_driver.guided import Choice
from robot_driver.host import TIOCGEXCL
from robot_driver.serial_port import NUMBERED, PSEUDO_TERMINALS

REFUSED = "Another program is using"
WARNED = "belongs to another device"
REFUSING = 10.0  # s within which a second driver must be refused
LONGEST_GAP = 0.25  # s between readings of the first driver while the second one tries
HAND = 60.0  # s for a person to pull a cable
SKIPPED = Choice("skip", "I cannot do that with this robot")
DONE = Choice("done", "it is done")


def session(run: Run) -> None:
    """Test the driver on the port: its warning about a numbered one, a second driver, and faults by hand."""
    if not run.wants(5, 10, 11, 12):
        return
    bench, port = run.bench, run.bench.setup.settings.port
    numbered = numbered_name(port)
    bench.start(direct=numbered or port, rate=RATE, state="direct")
    try:
        if not bench.until_ready():
            said = f"the driver did not begin: {bench.errors().strip()}"
            run.note(*(Finding(promise, "on the port", None, said) for promise in (10, 11, 12)))
            return
        if run.wants(11):
            _warned(run, numbered)
        if run.wants(12):
            run.attempt(lambda run: _second(run, port))
        if run.wants(5, 10):
            _by_hand(run)
    finally:
        bench.end()
    if run.wants(11) and numbered and numbered != port:
        _not_warned(run, port)


def numbered_name(path: str) -> str | None:
    """Return the name of a port that depends on the order of plugging, following links; None if it has none."""
    seen = 0
    while seen < 10:
        if NUMBERED.fullmatch(path):
            return path
        if not Path(path).is_symlink():
            return None
        path, seen = os.path.normpath(Path(path).parent / Path(path).readlink()), seen + 1
    return None


def _warned(run: Run, numbered: str | None) -> None:
    if numbered is None:
        run.note(Finding(11, "warned", None, f"{run.bench.setup.settings.port} has no number that could change"))
        return
    run.still(SETTLING, run.zero)
    on_terminal = WARNED in run.bench.errors()
    on_bus = any(WARNED in one.message for one in run.bench.record.statuses[-2:])
    said = f"{numbered}: a warning {'' if on_terminal else 'not '}on the terminal, {'' if on_bus else 'not '}on the bus"
    run.note(Finding(11, "warned", on_terminal and on_bus, said))


def _not_warned(run: Run, port: str) -> None:
    run.bench.start(direct=port, rate=RATE, state="direct")
    run.bench.until_ready()
    warned = WARNED in run.bench.errors()
    run.bench.end()
    said = f"{port}, which stays, draws {'a' if warned else 'no'} warning"
    run.note(Finding(11, "not without need", not warned, said))


def _second(run: Run, port: str) -> None:
    """Start a second driver on the same port while the first one drives."""
    bench = run.bench
    begun = time.monotonic_ns()
    settings = replace(bench.setup.settings, port=port, gyro_port=None, state=bench.setup.folder / "second")
    second = bench.other_driver(settings)
    run.moving(
        "second driver", "A second driver tries to take the port.", REFUSING, until=lambda: second.poll() is not None
    )
    code = second.poll()
    if code is None:
        second.terminate()
        second.wait()
    refused = code == 1 and REFUSED in bench.errors()
    said = "refused, with a sentence" if refused else f"not refused: it ended with {code}"
    run.note(Finding(12, "second driver", refused, said))
    run.still(0.3, run.zero)
    stamps = [one.utime for one in bench.record.feedback_in(Span(begun, time.monotonic_ns()))]
    gap = max((after - before for before, after in pairwise(stamps)), default=10**7) / 1e6
    said = f"the first driver went on, with {milliseconds(gap)} between readings at most"
    run.note(Finding(12, "first driver", gap < LONGEST_GAP, said, {"longest_gap_s": gap}))
    run.note(_kernel_lock(port))


def _kernel_lock(port: str) -> Finding:
    """Judge whether the kernel refuses the port, too: only root may open it; opening it as root reveals the lock."""
    if os.path.realpath(port).startswith(PSEUDO_TERMINALS):
        return Finding(12, "TIOCEXCL", None, "a pseudo-terminal: there the kernel's lock would outlive the driver")
    try:
        descriptor = os.open(port, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        refused = error.errno == errno.EBUSY
        return Finding(12, "TIOCEXCL", refused, f"the kernel says to another program: {error.strerror}")
    locked = bool(int.from_bytes(fcntl.ioctl(descriptor, TIOCGEXCL, bytes(4)), sys.byteorder))
    os.close(descriptor)
    return Finding(12, "TIOCEXCL", locked, f"the kernel's lock is {'set' if locked else 'not set'}")


def _by_hand(run: Run) -> None:
    """Ask the person to pull the cable, and to switch the battery off."""
    if not run.hands:
        why = "nobody was there to do it (--no-hands)"
        run.note(Finding(10, "by hand", None, f"unplugging by hand: {why}"))
        run.note(Finding(5, "battery off", None, f"switching the battery off: {why}"))
        return
    if run.wants(10):
        _pull_cable(run)
    if run.wants(5):
        _switch_off(run)


def _is_ready(run: Run, name: str, text: str, ready: str, otherwise: Finding) -> bool:
    """Ask the person to get ready; return whether they are, otherwise record a finding."""
    if run.guide.ask(name, text, (Choice("ready", ready), SKIPPED)) != SKIPPED.key:
        return True
    run.note(otherwise)
    return False


def _pull_cable(run: Run) -> None:
    text = "Take hold of the USB cable of the motor controller. The wheels will turn: pull it out then."
    otherwise = Finding(10, "by hand", None, "unplugging by hand: not possible with this robot")
    if not _is_ready(run, "hand-cable", text, "my hand is at the cable", otherwise):
        return
    record, before = run.bench.record, len(run.bench.record.statuses)
    run.drive_until_moving()
    run.moving("hand-pull", "Pull the cable out now.", HAND, until=lambda: _lost(record, before))
    run.still(SETTLING, run.wave)
    lost = _lost(record, before)
    if lost is None:
        run.note(Finding(10, "by hand", False, "no loss of the port was reported"))
        return
    last = max(one.utime for one in record.feedback if one.utime <= lost.utime)
    seconds = (lost.utime - last) / 1e6
    said = f"reported {milliseconds(seconds)} after the last reading: {lost.message[:80]}"
    run.note(Finding(10, "by hand", seconds < 0.5 + HELD_UP, said, {"reported_s": seconds}))
    run.guide.ask("hand-plug", "Put the cable back in.", (DONE,))
    back = run.bench.until_ready()
    run.note(Finding(10, "back", back, "ready again" if back else "not ready again"))
    _bound(run, last)


def _bound(run: Run, last: int) -> None:
    """Bound the time to stop by the counts gained while the cable was out, if the device kept counting."""
    run.bench.go_on(1.0, run.zero)
    before = [one for one in run.bench.record.feedback if last - 300_000 <= one.utime <= last]
    after = run.bench.record.feedback[-1]
    speed = abs(before[-1].ticks_left - before[0].ticks_left) / max((before[-1].utime - before[0].utime) / 1e6, 1e-6)
    gained = abs(after.ticks_left - before[-1].ticks_left)
    if speed < stops.LEAST_SPEED or not gained:
        run.note(Finding(6, "cable out", None, "the device was reset with the cable, or the wheels did not turn"))
        return
    seconds = gained / speed
    passed = seconds <= stops.WATCHDOG + stops.COASTING + HELD_UP
    said = f"{gained} counts gained at {speed:.0f} counts/s with the cable out: stopped within {seconds:.2f} s, at most"
    run.note(Finding(6, "cable out", passed, said, {"bound_s": seconds}))


def _lost(record: Record, since: int) -> process_status_t | None:
    return next((one for one in record.statuses[since:] if one.state == process_status_t.DEGRADED), None)


def _switch_off(run: Run) -> None:
    text = "Have a hand at the switch of the robot's battery. The wheels will turn: switch it off then."
    otherwise = Finding(5, "battery off", None, "switching the battery off: not possible with this robot")
    if not _is_ready(run, "hand-switch", text, "my hand is at the switch", otherwise):
        return
    record, before = run.bench.record, len(run.bench.record.statuses)
    run.drive_until_moving()
    run.moving("hand-off", "Switch the battery off now.", HAND, until=lambda: _lost(record, before))
    noticed = _lost(record, before) is not None
    run.guide.ask("hand-on", "Switch the battery on again.", (DONE,))
    back = run.bench.until_ready() and run.drive_until_moving()
    process = run.bench.process
    alive = process is not None and process.poll() is None
    said = f"{'reported' if noticed else 'not reported'}, and {'driven' if back else 'not driven'} again afterwards"
    run.note(Finding(5, "battery off", noticed and back and alive, said))
