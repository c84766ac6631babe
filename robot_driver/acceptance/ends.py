"""Steps that kill the driver or its gate, end it by a signal, or engage an emergency stop."""

import signal
import time

from robot_driver.acceptance import stops
from robot_driver.acceptance.bench import kill
from robot_driver.acceptance.filter import SECOND
from robot_driver.acceptance.findings import Finding
from robot_driver.acceptance.record import Span
from robot_driver.acceptance.running import ACCELERATION, RATE, Run

ALONE = 0.1  # s within which the gate sends zero after the driver was killed
OLD = 2.0  # s, age of a release that is too old to be accepted
LISTENING = 1.5  # s after the start, in which nothing may move while a stop is engaged
STOPPED = 0.25  # s within which an emergency stop must be on the wire


def session(run: Run) -> None:
    """Start and end the driver in all ways."""
    steps = {
        by_signal: (9,),
        engaged_before: (18,),
        released: (18,),
        latched: (19,),
        driver_killed: (6,),
        both_killed: (6,),
    }
    chosen = [step for step, promises in steps.items() if run.wants(*promises)]
    if not chosen:
        return
    with run.bench.relayed():
        for step in chosen:
            run.attempt(step)
            run.bench.estop = None


def _start(run: Run, state: str) -> bool:
    run.bench.start(rate=RATE, acceleration=ACCELERATION, state=state)
    return run.bench.until_ready() and run.drive_until_moving()


def _not_driven(run: Run, promise: int, check: str) -> None:
    process = run.bench.process
    ended = process is None or process.poll() is not None
    said = "the driver ended" if ended else "the motors were not driven"
    run.note(Finding(promise, check, False, said))
    run.bench.end()


def by_signal(run: Run) -> None:
    """End the driver by SIGTERM and by SIGINT while it drives; the first answer to zero is lost."""
    for number in (signal.SIGTERM, signal.SIGINT):
        check = f"ended by {number.name}"
        if not _start(run, "state"):
            _not_driven(run, 9, check)
            continue
        run.line.faults.lose_next_zero = True
        at = time.monotonic_ns()
        code = run.bench.end(number)
        ended = time.monotonic_ns()
        run.line.faults.lose_next_zero = False
        run.note(stops.ended_at_zero(check, run.bench.wire(), at, ended, code))


def engaged_before(run: Run) -> None:
    """Start the driver while an emergency stop is engaged: it must receive the stop before any command."""
    run.bench.set_estop(True)
    run.bench.start(rate=RATE, acceleration=ACCELERATION, state="engaged-before")
    begun = time.monotonic_ns()
    run.bench.go_on(LISTENING + 1.5, run.wave, until=lambda: _served_for(run, begun, LISTENING))
    run.note(
        stops.nothing_moves(18, "engaged before the start", run.bench.wire(), Span(begun, time.monotonic_ns()), "held")
    )
    run.bench.set_estop(False)
    run.still(0.5, run.zero)
    run.bench.end()


def _served_for(run: Run, begun: int, seconds: float) -> bool:
    """Return whether the driver has sent duties for this time."""
    times = [one.asked for one in run.bench.wire().drives if one.asked > begun]
    return bool(times) and times[-1] - times[0] > seconds * SECOND


def released(run: Run) -> None:
    """Engage the stop while the robot drives, and release it while a duty is commanded continuously."""
    bench = run.bench
    if not _start(run, "released"):
        _not_driven(run, 18, "released")
        return
    at = bench.set_estop(True)
    span = run.moving("estop", "ESTOP is engaged.", 1.0)
    run.note(stops.zero_within(18, "engaged", bench.wire(), Span(at, span.end), STOPPED))
    bench.estop = None
    _release_too_old(run)
    bench.set_estop(False)
    span = run.moving("release", "ESTOP is released; a duty is commanded, but no zero.", 0.4)
    bench.estop = None
    rest = run.moving("no zero", "A duty is commanded, but no zero.", 0.8)
    run.note(stops.nothing_moves(18, "released", bench.wire(), Span(span.begin, rest.end), "no zero after the release"))
    run.still(0.2, run.zero)
    span = run.moving("zero came", "Zero was commanded; driving.", 1.0)
    run.note(stops.moves(18, "zero commanded", bench.wire(), span, "after zero"))
    bench.end()


def _release_too_old(run: Run) -> None:
    """Release the stop by an outdated message; then send zero, then a duty: all must be ignored."""
    bench = run.bench
    bench.release(age=OLD)
    begun = time.monotonic_ns()
    run.still(0.1, run.zero)
    run.still(0.4, run.wave)
    span = Span(begun, time.monotonic_ns())
    run.note(stops.nothing_moves(18, "a release that is too old", bench.wire(), span, "not released"))


def latched(run: Run) -> None:
    """Engage the stop, kill the driver, and start it again while nobody repeats the stop."""
    bench = run.bench
    if not _start(run, "latched"):
        _not_driven(run, 19, "latched")
        return
    bench.set_estop(True)
    run.still(0.5)
    stored = bool(bench.record.latches) and bool(bench.record.latches[-1].engaged and bench.record.latches[-1].stored)
    run.note(Finding(19, "stored", stored, "the stop is on the disk" if stored else "the stop is not on the disk"))
    bench.estop = None
    bench.end(signal.SIGKILL)
    bench.start(rate=RATE, acceleration=ACCELERATION, state="latched")
    begun = time.monotonic_ns()
    run.still(0.8, run.zero)
    bench.go_on(LISTENING + 1.5, run.wave, until=lambda: _served_for(run, begun, LISTENING))
    span = Span(begun, time.monotonic_ns())
    run.note(stops.nothing_moves(19, "after a restart", bench.wire(), span, "held by the stop on the disk"))
    bench.release(name="")
    run.still(0.2, run.zero)
    span = run.still(0.4, run.wave)
    run.note(stops.nothing_moves(19, "a release without a name", bench.wire(), span, "not released"))
    bench.set_estop(False)
    run.still(0.4, run.zero)
    bench.estop = None
    span = run.moving("released", "Released; driving.", 1.0)
    run.note(stops.moves(19, "released", bench.wire(), span, "after a release with name and reason, and zero"))
    bench.end()


def driver_killed(run: Run) -> None:
    """Kill the driver while it drives: the gate sends zero."""
    if not _start(run, "killed"):
        _not_driven(run, 6, "driver killed")
        return
    process = run.bench.process
    assert process is not None
    at = kill(process.pid)
    process.wait()
    run.still(0.3)
    run.bench.ask_counts(1.0)
    span = Span(at, time.monotonic_ns())
    run.note(stops.zero_within(6, "driver killed (SIGKILL)", run.bench.wire(), span, ALONE))
    run.bench.end()


def both_killed(run: Run) -> None:
    """Kill gate and driver: nobody writes any more, and the device must stop the motors itself."""
    if not _start(run, "both-killed"):
        _not_driven(run, 6, "driver and gate killed")
        return
    process, gate = run.bench.process, run.bench.gate_pid()
    assert process is not None
    at = kill(gate, process.pid)
    process.wait()
    run.still(2.0)
    run.bench.ask_counts(0.2)
    run.note(stops.bounded(6, "driver and gate killed (SIGKILL)", run.bench.wire(), at, stops.WATCHDOG, at + SECOND))
    run.bench.end()
