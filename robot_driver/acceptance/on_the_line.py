"""Steps on the filtered line, in one session with one driver: first a good line, then a degraded one."""

import signal
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from cmr.msg import motor_feedback_t
from robot_driver.acceptance import gyros, judges, stops
from robot_driver.acceptance.dialects import COUNTER_RANGE
from robot_driver.acceptance.filter import SECOND, Faults, GyroFaults, shifted
from robot_driver.acceptance.findings import Finding
from robot_driver.acceptance.record import Drive, Span
from robot_driver.acceptance.running import ACCELERATION, RATE, SETTLING, Run
from robot_driver.controllers import CONTROLLERS
from robot_driver.gyros import GYROS

BEFORE_WRAP = 100  # counts before the counters' wrap, at the start
JUMP = 2**30  # counts
GAP = 5_000_000  # ns between the bytes of replies in pieces
ADDED = 0.016  # s, delay of replies by a USB adapter
ON_THE_LINE = 1, 2, 3, 4, 5, 6, 7, 8, 10, 13, 14, 15, 17  # promises tested here
STARTS = 3  # attempts to start the driver on a delayed computer
BURST = 50_000_000  # ns


def session(run: Run) -> None:
    """Drive on a line degraded in one way after the other. Each step leaves the driver ready."""
    steps: dict[Callable[[Run], None], tuple[int, ...]] = {
        latency: (17,),
        pieces: (1,),
        losses: (2, 4),
        damage: (3, 15),
        bursts: (14,),
        gyro_off: (15,),
        jump: (13,),
        silence: (5,),
        deaf: (6,),
        watchdog_lost: (7,),
        reset: (13,),
        stale: (8,),
        paused: (6, 8),
        unplugged: (10,),
        watchdog_refused: (7,),
    }
    chosen = [step for step, promises in steps.items() if run.wants(*promises)]
    if not chosen and not run.wants(7, 13, 14, 17):
        return
    with run.bench.relayed():
        begin_before_wrap(run)
        if not begin(run):
            return
        for step in chosen:
            run.attempt(partial(restored, step))


def restored(step: Callable[[Run], None], run: Run) -> None:
    """Perform a step on a restored line."""
    run.restore()
    step(run)


def begin_before_wrap(run: Run) -> None:
    """Set the counts to just before the wrap of the counters."""
    run.bench.ask_counts(0.1)
    counts = _last_counts(run)
    run.line.forgery.offset = COUNTER_RANGE - BEFORE_WRAP - counts[0], COUNTER_RANGE - BEFORE_WRAP - counts[1]


def _last_counts(run: Run) -> tuple[int, int]:
    """Return the true last counts of the device."""
    said = (run.line.dialect.counts(one.reply) for one in reversed(run.line.exchanges))
    return next((counts for counts in said if counts is not None), (0, 0))


def begin(run: Run) -> bool:
    """Start the driver and drive for a while, as a reference for everything else."""
    for _ in range(STARTS):
        begun = time.monotonic_ns()
        run.bench.start(rate=RATE, acceleration=ACCELERATION)
        if run.bench.until_ready() or not run.held_up.longest(Span(begun, time.monotonic_ns())):
            break
        run.bench.end()
    if not run.bench.is_ready:
        said = run.bench.record.statuses[-1].message if run.bench.record.statuses else run.bench.errors().strip()
        promises = [promise for promise in ON_THE_LINE if promise != 7]
        run.note(*(Finding(promise, "ready", None, f"the driver did not begin: {said}") for promise in promises))
        unarmed = "watchdog" in said
        run.note(Finding(7, "ready", False if unarmed else None, f"the driver did not begin: {said}"))
        return False
    run.attempt(partial(steady, begun))
    return run.turns


def steady(begun: int, run: Run) -> None:
    """Drive on a good line: forward over the end of the counters, and back; longer if stamps are tested."""
    seconds = run.pace.steady if run.wants(14, 17) else 3.0
    forth = run.moving("steady", f"Driving steadily, for {seconds:.0f} s. Any key ends everything.", seconds)
    back = run.moving("backward", "Driving backward.", run.pace.brief, run.back)
    again = run.moving("forward", "Driving forward again.", 1.0)
    run.still(SETTLING, run.zero)
    record, wire = run.bench.record, run.bench.wire()
    whole = Span(forth.begin, again.end)
    if (wire.gained(forth.begin + SECOND // 2, forth.end) or 0) / forth.seconds < stops.LEAST_SPEED:
        said = f"the wheels do not turn at {100 * run.bench.setup.duty:.0f} % duty: give more, with --duty"
        run.note(*(Finding(promise, "turning", None, said) for promise in ON_THE_LINE))
        return
    run.turns = True
    run.good = Span(max(forth.begin, forth.end - 10 * SECOND), forth.end)
    run.settle_constant(Span(forth.begin, forth.begin + SECOND))
    run.note(
        judges.armed_before_driven(wire, Span(begun, forth.end)),
        judges.read_while_driving(wire, Span(forth.begin, min(forth.end, forth.begin + 60 * SECOND))),
        judges.truth(13, "wrap", record, wire, whole, run.constant),
        _no_jumps(run, whole),
        gyros.increasing("MOTOR_FEEDBACK", [one.utime for one in record.feedback], whole.seconds),
        judges.stated(record, wire, Span(forth.begin, back.begin), 0.0),
    )
    if record.gyro:
        run.note(gyros.increasing("GYRO", [one.utime for one in record.gyro], whole.seconds))
    run.figures |= judges.round_trips(record, wire, whole)


def _no_jumps(run: Run, span: Span) -> Finding:
    jumps = sum(bool(one.status & motor_feedback_t.STATUS_ENCODER_JUMP) for one in run.bench.record.feedback_in(span))
    return Finding(13, "no jump at the wrap", not jumps, f"{jumps} jumps reported while the counts wrapped")


def latency(run: Run) -> None:
    """Hold replies back, as a USB adapter does; the driver must report it."""
    run.line.faults = Faults(latency=round(ADDED * SECOND))
    span = run.moving("latency", "Driving behind a slow adapter.", max(run.pace.faulty / 2, 3.0))
    run.still(SETTLING, run.zero)
    run.note(judges.stated(run.bench.record, run.bench.wire(), Span(span.end, time.monotonic_ns()), ADDED))


def pieces(run: Run) -> None:
    """Send replies byte by byte."""
    run.line.faults = Faults(gap=GAP)
    span = run.moving("pieces", "Driving while replies come in pieces.", max(run.pace.faulty / 2, 2.0))
    run.line.faults = Faults()
    record, wire = run.bench.record, run.bench.wire()
    run.note(
        judges.none_lost(1, "none lost", record, wire, span),
        judges.truth(1, "none corrupt", record, wire, span, run.constant),
    )


def losses(run: Run) -> None:
    """Lose one reply in twenty."""
    run.line.faults = Faults(lose=0.05)
    span = run.moving("losses", "Driving while replies are lost.", run.pace.faulty)
    run.line.faults = Faults()
    settings, wire = run.bench.setup.settings, run.bench.wire()
    baud = settings.baud or CONTROLLERS[settings.controller].default_baud_rate
    run.note(judges.rhythm(wire, run.good, span, RATE), judges.cost_of_loss(wire, span, baud))


def damage(run: Run) -> None:
    """Damage requests and replies, also the gyro's, and delay replies."""
    run.line.faults = Faults(damage=0.2, damage_requests=0.03, delay=0.08)
    if run.bench.gyro is not None:
        run.bench.gyro.faults = GyroFaults(damage=0.01)
    span = run.moving("damage", "Driving while the line damages what passes.", 1.5 * run.pace.faulty)
    run.line.faults = Faults()
    if run.bench.gyro is not None:
        run.bench.gyro.faults = GyroFaults()
    record, wire = run.bench.record, run.bench.wire()
    inner = Span(span.begin + SECOND // 5, span.end)
    run.note(
        judges.truth(3, "ticks", record, wire, inner, run.constant),
        judges.duties_true(record, wire, inner, run.bench.setup.settings.wiring),
    )
    if said := said_by_gyro(run):
        run.note(gyros.only_rates("damage", record, said, span, sign_of_gyro(run)))
    else:
        run.note(Finding(15, "damage", None, "no gyro on a port of its own (--gyro-port)"))


def said_by_gyro(run: Run) -> list[gyros.Said]:
    """Return the readings of the gyro on its own port; empty without one."""
    if run.bench.gyro is None:
        return []
    kind = GYROS[run.bench.setup.settings.gyro or "dsp3000"]
    return gyros.said_by(kind(), run.bench.gyro)


def sign_of_gyro(run: Run) -> float:
    """Return the sign with which the driver counts the gyro."""
    return -1.0 if run.bench.setup.settings.invert_gyro else 1.0


def bursts(run: Run) -> None:
    """Send the gyro's readings in bursts."""
    if run.bench.gyro is None:
        run.note(Finding(14, "bursts", None, "no gyro on a port of its own (--gyro-port)"))
        return
    run.bench.gyro.faults = GyroFaults(hold=BURST)
    span = run.still(max(run.pace.faulty, 3.0), run.zero)
    run.bench.gyro.faults = GyroFaults()
    rate = GYROS[run.bench.setup.settings.gyro or "dsp3000"]().nominal_rate
    inner = Span(span.begin + SECOND, span.end - SECOND // 10)
    run.note(gyros.spread(run.bench.record, said_by_gyro(run), inner, sign_of_gyro(run), rate))


def gyro_off(run: Run) -> None:
    """Switch the gyro off for a while."""
    if run.bench.gyro is None:
        return
    run.bench.gyro.faults = GyroFaults(off=True)
    gap = run.still(run.pace.brief, run.zero)
    run.bench.gyro.faults = GyroFaults()
    span = run.still(2.0, run.zero)
    run.note(gyros.none_valid("gap", run.bench.record, gap, "the gyro was off"))
    after = gyros.only_rates("after the gap", run.bench.record, said_by_gyro(run), span, sign_of_gyro(run))
    run.note(after)
    if run.bench.setup.settings.gyro not in (None, "dsp3000"):
        return
    run.bench.gyro.faults = GyroFaults(invalid=True)
    span = run.still(run.pace.brief, run.zero)
    run.bench.gyro.faults = GyroFaults()
    run.note(gyros.none_valid("not valid", run.bench.record, span, "the gyro said that nothing was valid"))


def jump(run: Run) -> None:
    """Make the counts jump, once; they are large from then on."""
    run.moving("before a jump", "Driving.", 1.0)
    run.line.forgery = replace(run.line.forgery, offset=shifted(run.line.forgery.offset, (JUMP, JUMP)))
    jumped = time.monotonic_ns()
    run.moving("jump", "Driving on, while the counts jump.", 1.0)
    record, wire = run.bench.record, run.bench.wire()
    span = Span(jumped + SECOND // 2, time.monotonic_ns())
    ticks = judges.Ticks(record, wire)
    before, after = run.constant, ticks.constant(record.feedback_in(span))
    run.constant = after
    flagged = any(
        one.status & motor_feedback_t.STATUS_ENCODER_JUMP for one in record.feedback_in(Span(jumped, span.end))
    )
    missed = max(abs(after[side] - before[side]) for side in (0, 1)) if before and after else JUMP
    passed = flagged and missed <= 0.1 * wire.speed(jumped) + 2
    said = f"a jump of {JUMP} counts was {'' if flagged else 'not '}reported, and {missed} of it were counted"
    run.note(Finding(13, "jump", passed, said, {"counted": missed}))


def silence(run: Run) -> None:
    """Withhold all replies for a while, with the motors running until they stop."""
    if not run.drives(5, "silence"):
        return
    begun = time.monotonic_ns()
    run.line.faults = Faults(silent=True)
    run.moving("silence", "The device answers nothing.", max(2.0, run.pace.brief))
    run.line.faults = Faults()
    back = time.monotonic_ns()
    run.moving("silence over", "It answers again.", 3.0)
    record, wire = run.bench.record, run.bench.wire()
    process = run.bench.process
    alive = process is not None and process.poll() is None
    run.note(Finding(5, "lives on", alive, "the driver lived on" if alive else "the driver ended"))
    drives = wire.drives_in(Span(back, time.monotonic_ns()))
    again = any(drive.moves and drive.acknowledged for drive in drives)
    run.note(Finding(5, "resumes", again, "it drove again" if again else "it did not drive again"))
    run.note(judges.ramp(5, "from zero", _from_zero(drives), ACCELERATION, RATE))
    later = Span(back + SECOND, time.monotonic_ns())
    run.note(judges.truth(5, "counted", record, wire, later, run.constant))
    run.note(stops.bounded(5, "time to stop", wire, begun, 1.4, back))


def _from_zero(drives: list[Drive]) -> list[Drive]:
    """Return the duties from the first one that is not zero on."""
    first = next((number for number, drive in enumerate(drives) if drive.moves), len(drives))
    return drives[first:]


def deaf(run: Run) -> None:
    """Send the device meaningless bytes: the driver must leave it alone until its watchdog stops the motors."""
    if not run.drives(6, "a deaf device"):
        return
    begun = time.monotonic_ns()
    run.line.faults = Faults(deaf=True)
    run.moving("deaf", "The device understands nothing.", 3.5)
    run.line.faults = Faults()
    heard = time.monotonic_ns()
    run.bench.until_ready()
    run.still(0.3, run.zero)
    run.note(stops.bounded(6, "a deaf device", run.bench.wire(), begun, 1.5, heard))


def watchdog_lost(run: Run) -> None:
    """Report that the device has lost its watchdog."""
    if not run.drives(7, "armed again"):
        return
    lost = time.monotonic_ns()
    run.line.forgery.watchdog_lost = True
    run.moving("watchdog", "The device has lost its watchdog.", 1.5)
    run.note(judges.armed_again(run.bench.wire(), lost, time.monotonic_ns()))
    run.line.forgery.watchdog_lost = False
    run.bench.until_ready()
    span = run.moving("armed again", "Driving.", 0.5)
    run.settle_constant(span)


def watchdog_refused(run: Run) -> None:
    """Acknowledge the watchdog without setting it: then nothing may move."""
    relay = run.bench.relay
    assert relay is not None
    run.line.forgery.watchdog_lost = run.line.forgery.watchdog_refused = True
    relay.unplug()
    run.still(0.3, run.zero)
    begun = time.monotonic_ns()
    relay.plug_in()
    run.moving("no watchdog", "The device takes no watchdog.", 3.0)
    span = Span(begun, time.monotonic_ns())
    run.line.forgery.watchdog_lost = run.line.forgery.watchdog_refused = False
    run.note(stops.nothing_moves(7, "read back", run.bench.wire(), span, "a device that takes no watchdog"))


def reset(run: Run) -> None:
    """Reset the device: its counts begin at zero, and it has no watchdog."""
    if not run.drives(13, "reset"):
        return
    before, last = run.bench.record.feedback[-1], _last_counts(run)
    run.line.forgery = replace(run.line.forgery, offset=(-last[0], -last[1]), watchdog_lost=True)
    begun = time.monotonic_ns()
    run.moving("reset", "The device was reset.", 1.0)
    run.line.forgery.watchdog_lost = False
    run.bench.until_ready()
    span = run.moving("after the reset", "Driving.", 0.7)
    record, wire = run.bench.record, run.bench.wire()
    run.settle_constant(span)
    whole = Span(begun, span.end)
    after = record.feedback_in(whole)
    true = wire.gained(begun, span.end - SECOND // 20) or 0
    said = abs(after[-1].ticks_left - before.ticks_left) if after else JUMP
    told = [one.message for one in record.statuses_in(whole) if "was reset" in one.message]
    jumps = any(one.status & motor_feedback_t.STATUS_ENCODER_JUMP for one in after)
    passed = bool(told) and not jumps and said <= true + 0.1 * wire.speed(begun) + 5
    words = f"a reset was {'' if told else 'not '}reported{', as a jump' if jumps else ''}; {said} counts were added "
    run.note(Finding(13, "reset", passed, words + f"while the wheels gained {true}", {"added": said, "gained": true}))


def stale(run: Run) -> None:
    """Stop commanding; then send old commands; then new ones."""
    if not run.drives(8, "stale"):
        return
    last = run.bench.commanded
    silent = run.still(1.2)
    wire = run.bench.wire()
    run.note(stops.zero_within(8, "stale", wire, Span(last, silent.end), 0.5 + 1.0 / RATE))
    begun = time.monotonic_ns()
    for _ in range(25):
        run.bench.command(*run.wave(0.0), age=1.0)
        run.still(0.02)
    run.note(
        stops.nothing_moves(8, "old commands", run.bench.wire(), Span(begun, time.monotonic_ns()), "commands 1 s old")
    )
    span = run.moving("resume", "Driving again.", 1.0)
    run.note(judges.ramp(8, "resume", _from_zero(run.bench.wire().drives_in(span)), ACCELERATION, RATE))


def paused(run: Run) -> None:
    """Suspend the driver's process as by Ctrl-Z while it drives, and resume it."""
    if not run.drives(6, "driver stopped (SIGSTOP)"):
        return
    process = run.bench.process
    assert process is not None
    at = time.monotonic_ns()
    process.send_signal(signal.SIGSTOP)
    span = run.moving("paused", "The driver's process is stopped.", 1.2)
    run.note(stops.zero_within(6, "driver stopped (SIGSTOP)", run.bench.wire(), Span(at, span.end), 0.5 + 1.0 / RATE))
    process.send_signal(signal.SIGCONT)
    span = run.still(0.5)
    run.note(stops.nothing_moves(8, "after a pause", run.bench.wire(), span, "what waited meanwhile"))


def unplugged(run: Run) -> None:
    """Remove the driver's port, and bring it back."""
    relay = run.bench.relay
    assert relay is not None
    if not run.drives(10, "reported"):
        return
    out = time.monotonic_ns()
    relay.unplug()
    run.moving("unplugged", "The driver's port is gone.", 1.7)
    relay.plug_in()
    back = time.monotonic_ns()
    run.moving("plugged in", "It is back.", 2.5)
    run.note(*stops.unplugged(run.bench.record, run.bench.wire(), out, back, time.monotonic_ns()))
