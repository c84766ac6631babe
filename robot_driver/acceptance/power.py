"""Steps with a forged battery voltage, and with a slow line."""

import time

from cmr.msg import motor_feedback_t
from robot_driver.acceptance import judges, stops
from robot_driver.acceptance.dialects import Kind
from robot_driver.acceptance.filter import SECOND, Faults
from robot_driver.acceptance.findings import Finding
from robot_driver.acceptance.record import Span
from robot_driver.acceptance.running import ACCELERATION, RATE, SETTLING, Run

WARN, STOP = 11.0, 10.0  # V, settings of the driver
FULL, LOW, EMPTY = 12.0, 10.5, 9.0  # V, reported to it
DELAY = 2.0  # s below a threshold before it counts
SLOW_BAUD = 2400
SLOW_RATE = 5.0  # Hz; all requests take 0.16 s at that baud rate


def session(run: Run) -> None:
    """Test the battery's thresholds."""
    if run.wants(16):
        run.attempt(battery)


def battery(run: Run) -> None:
    """Start the driver with a battery that is unknown, full, low, empty, and full again."""
    bench = run.bench
    with bench.relayed():
        run.line.forgery.voltage = FULL
        run.line.faults = Faults(withheld=frozenset({Kind.VOLTAGE}))
        bench.start(rate=RATE, acceleration=ACCELERATION, battery_warn=WARN, battery_stop=STOP, state="battery")
        begun = time.monotonic_ns()
        run.still(2.0, run.zero)
        bench.go_on(2.0, run.wave)
        span = Span(begun, time.monotonic_ns())
        run.note(stops.nothing_moves(16, "unknown", bench.wire(), span, "while the voltage is not known"))
        run.line.faults = Faults()
        if not (bench.until_ready() and run.drive_until_moving()):
            run.note(Finding(16, "known", False, "it did not drive when the voltage was known"))
            return
        _low(run)
        _empty(run)
        bench.end()


def _low(run: Run) -> None:
    run.line.forgery.voltage = LOW
    begun = time.monotonic_ns()
    run.moving("low battery", "Driving with a battery that is reported as low.", DELAY + 2 * SETTLING)
    now = time.monotonic_ns()
    told = judges.said_degraded(run.bench.record, begun, now, "battery is low")
    said = "a low battery was reported" if told else "a low battery was not reported"
    run.note(Finding(16, "low", told is not None, said))
    drives = run.bench.wire().drives_in(Span(begun, now))
    run.note(Finding(16, "low drives", bool(drives) and drives[-1].moves, "it drives on with a low battery"))


def _empty(run: Run) -> None:
    run.line.forgery.voltage = EMPTY
    begun = time.monotonic_ns()
    run.moving("empty battery", "Driving with a battery that is reported as empty.", DELAY + 2.0)
    moved = [drive.asked for drive in run.bench.wire().drives_in(Span(begun, time.monotonic_ns())) if drive.moves]
    zero = run.bench.wire().first_zero(moved[-1] if moved else begun)
    said = "an empty battery did not stop it"
    if zero is not None:
        said = f"stopped {(zero.asked - begun) / SECOND:.1f} s after it was empty"
    flagged = any(one.status & motor_feedback_t.STATUS_BATTERY for one in run.bench.record.feedback[-20:])
    run.note(Finding(16, "empty", zero is not None and flagged, said))
    run.line.forgery.voltage = FULL
    run.still(1.0, run.zero)
    span = run.moving("recovered", "The battery is reported as full again.", 1.5)
    run.note(stops.nothing_moves(16, "for good", run.bench.wire(), span, "though the battery recovered"))


def slow_line(run: Run) -> None:
    """Drive on a line with an apparent 2400 baud and a slow adapter, with a driver configured for it."""
    if run.wants(4):
        run.attempt(slow)


def slow(run: Run) -> None:
    """Drive at 2400 baud."""
    with run.bench.relayed():
        run.line.faults = Faults(baud=SLOW_BAUD)
        run.bench.start(baud=SLOW_BAUD, rate=SLOW_RATE, acceleration=ACCELERATION, state="slow")
        if not run.bench.until_ready():
            run.note(Finding(4, "slow line", False, f"no service at {SLOW_BAUD} baud"))
            return
        span = run.moving("slow line", f"Driving at {SLOW_BAUD} baud.", max(run.pace.faulty, 4.0))
        run.note(judges.none_lost(4, "slow line", run.bench.record, run.bench.wire(), span))
