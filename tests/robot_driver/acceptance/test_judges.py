"""What the judges say of recorded exchanges and messages, made up here; no bus, no clock."""

from collections.abc import Sequence

import pytest

from cmr.bus.messages import make
from cmr.msg import gyro_t, motor_feedback_t, process_status_t
from robot_driver.acceptance import gyros, judges, stops
from robot_driver.acceptance.dialects import RoboClawDialect
from robot_driver.acceptance.filter import SECOND, Exchange
from robot_driver.acceptance.findings import FAILED, NOT_TRIED, PASSED, Finding, failed, verdict
from robot_driver.acceptance.record import Drive, Record, Span, Wire
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.encoders import Wiring

MS = 1_000_000  # ns
CYCLE = 20 * MS
SPEED = 600  # counts/s
DIALECT = RoboClawDialect()
CLAW = RoboClaw()
ACK = b"\xff"


def exchange(asked: int, request: bytes, reply: bytes) -> Exchange:
    return Exchange(asked, request, request, reply, asked + 2 * MS if reply else 0, reply)


def drive(asked: int, duty: float, reply: bytes = ACK) -> Exchange:
    return exchange(asked, CLAW.drive(duty, duty).data, reply)


def counts(asked: int, count: int) -> Exchange:
    return exchange(asked, DIALECT.ask_counts, DIALECT.saying_counts((count % 2**32, count % 2**32)))


def driven(until: int, count: int = 0) -> list[Exchange]:
    """Return a drive at a tenth of the duty, from 0 on."""
    found = []
    for moment in range(0, until, CYCLE):
        found += [drive(moment, 0.1), counts(moment + 5 * MS, count + SPEED * moment // SECOND)]
    return found


def wire(exchanges: Sequence[Exchange]) -> Wire:
    return Wire(DIALECT, Wiring(), exchanges)


def feedback(moment: int, ticks: int, status: int = 0) -> motor_feedback_t:
    result = motor_feedback_t()
    result.utime, result.ticks_left, result.ticks_right, result.status = moment // 1000, ticks, ticks, status
    return result


def published(exchanges: Sequence[Exchange], start: int = 0) -> list[motor_feedback_t]:
    return [feedback(one.asked + MS, one.ticks[0] + start) for one in wire(exchanges).readings]


def test_true_ticks_pass_over_the_wrap_and_one_that_is_false_is_found() -> None:
    exchanges = driven(SECOND, count=2**32 - 100)
    span, record = Span(0, SECOND), Record(feedback=published(exchanges, start=17))
    constant = judges.steady_constant(record, wire(exchanges), span)
    assert judges.truth(13, "", record, wire(exchanges), span, constant).passed
    record.feedback[20] = feedback(record.feedback[20].utime * 1000, record.feedback[20].ticks_left + 1)
    finding = judges.truth(13, "", record, wire(exchanges), span, constant)
    assert finding.passed is False
    assert finding.values["false"] == 1


def test_a_late_reply_that_is_taken_for_anothers_is_false() -> None:
    exchanges = driven(SECOND)
    span, record = Span(0, SECOND), Record(feedback=published(exchanges))
    constant = judges.steady_constant(record, wire(exchanges), span)
    record.feedback[20] = feedback(record.feedback[20].utime * 1000, record.feedback[18].ticks_left)
    assert judges.truth(3, "", record, wire(exchanges), span, constant).passed is False


def test_zero_in_time_passes_and_late_or_none_or_followed_by_another_does_not() -> None:
    before = driven(SECOND)
    count = SPEED * (SECOND - CYCLE) // SECOND

    def judged(*after: Exchange) -> Finding:
        return stops.zero_within(
            6, "", wire([*before, *after, counts(2 * SECOND, count)]), Span(SECOND, 3 * SECOND), 0.1
        )

    assert judged(drive(SECOND + 50 * MS, 0.0)).passed
    assert judged(drive(SECOND + 500 * MS, 0.0)).passed is False
    assert judged(drive(SECOND + 50 * MS, 0.0, b"")).passed is False
    assert judged(drive(SECOND + 50 * MS, 0.0), drive(SECOND + 70 * MS, 0.1)).passed is False
    assert judged().passed is False


@pytest.mark.parametrize(("gained", "passed"), [(250, True), (1200, False)])
def test_the_time_to_stop_is_bounded_by_the_counts_that_were_gained(gained: int, passed: bool) -> None:
    last = SPEED * (SECOND - CYCLE) // SECOND
    finding = stops.bounded(6, "", wire([*driven(SECOND), counts(3 * SECOND, last + gained)]), SECOND, 0.5, 2 * SECOND)
    assert finding.passed is passed
    assert finding.values["bound_s"] == pytest.approx(gained / SPEED, rel=0.1)


def test_nothing_moves_only_where_the_motors_are_served() -> None:
    span = Span(0, SECOND)
    assert stops.nothing_moves(18, "", wire([drive(0, 0.0)]), span, "").passed
    assert stops.nothing_moves(18, "", wire([drive(0, 0.0), drive(1, 0.1)]), span, "").passed is False
    assert stops.nothing_moves(18, "", wire([]), span, "").passed is False


def test_a_jump_of_duty_is_distinguished_from_a_ramp() -> None:
    def drives(*duties: float) -> list[Drive]:
        return [Drive(0, (duty, duty), True, True) for duty in duties]

    assert judges.ramp(8, "", drives(0.01, 0.02, 0.03), 0.5, 50.0).passed
    assert judges.ramp(8, "", drives(0.1), 0.5, 50.0).passed is False
    assert judges.ramp(8, "", [], 0.5, 50.0).passed is False


def test_the_watchdog_is_set_and_read_back_before_any_duty() -> None:
    arm = exchange(0, CLAW.set_watchdog(0.5).data, ACK)
    read = exchange(MS, CLAW.read_watchdog().data, DIALECT.saying_watchdog(0.5))
    other = exchange(MS, CLAW.read_watchdog().data, DIALECT.saying_watchdog(0.0))
    span = Span(0, SECOND)
    assert judges.armed_before_driven(wire([arm, read, drive(5 * MS, 0.1)]), span).passed
    for wrong in ([arm, other, drive(5 * MS, 0.1)], [arm, drive(MS // 2, 0.1), read], [read, drive(5 * MS, 0.1)]):
        assert judges.armed_before_driven(wire(wrong), span).passed is False


def test_an_end_counts_only_with_zero_that_the_driver_saw_acknowledged() -> None:
    unseen = drive(SECOND, 0.0)
    unseen.delivered = b""
    assert stops.ended_at_zero("", wire([drive(SECOND, 0.0)]), SECOND, SECOND + 1, 130).passed
    assert stops.ended_at_zero("", wire([unseen]), SECOND, SECOND + 1, 130).passed is False
    assert stops.ended_at_zero("", wire([drive(SECOND, 0.0)]), SECOND, SECOND + 1, 0).passed is False
    assert stops.ended_at_zero("", wire([drive(SECOND, 0.0)]), SECOND, 3 * SECOND, 130).passed is False


def test_unplugging_is_reported_in_time_and_followed_by_zero() -> None:
    def judged(reported: int, *after: Exchange) -> list[bool | None]:
        status = process_status_t()
        status.utime, status.state, status.message = reported // 1000, process_status_t.DEGRADED, "gone"
        record = Record(statuses=[status])
        return [one.passed for one in stops.unplugged(record, wire(after), SECOND, 2 * SECOND, 5 * SECOND)]

    back = 2 * SECOND + SECOND // 2
    assert judged(SECOND + SECOND // 4, drive(back, 0.0), drive(back + CYCLE, 0.1)) == [True, True, True]
    assert judged(SECOND + 4 * SECOND // 5, drive(4 * SECOND, 0.1)) == [False, False, False]


def test_stamps_increase_and_what_was_not_said_is_no_rate() -> None:
    assert gyros.increasing("", [1, 2, 3], 1.0).passed
    assert gyros.increasing("", [1, 3, 2], 1.0).passed is False
    said = [gyros.Said(number * 10 * MS, 0.001 * number) for number in range(100)]
    heard = [
        make(gyro_t, utime=one.moment // 1000 - 5000, yaw_rate=one.rate, valid=1, robot_id=0, received_utime=0)
        for one in said
    ]
    span, record = Span(-SECOND, SECOND), Record(gyro=heard)
    assert gyros.only_rates("", record, said, span, 1.0).passed
    assert gyros.spread(record, said, span, 1.0, 100.0).passed
    assert gyros.none_valid("", record, span, "").passed is False
    heard[50].yaw_rate = 0.5
    assert gyros.only_rates("", record, said, span, 1.0).passed is False
    for one in heard:
        one.utime += 30_000
    assert gyros.spread(record, said, span, 1.0, 100.0).passed is False


def test_a_promise_fails_by_one_check_and_passes_by_one_that_was_tried() -> None:
    def found(*passed: bool | None) -> list[Finding]:
        return [Finding(6, "", one, "") for one in passed]

    assert verdict(6, found(True, None)) == PASSED
    assert verdict(6, found(True, False, None)) == FAILED
    assert verdict(6, found(None)) == verdict(7, found(True)) == NOT_TRIED
    assert failed(found(True, False, False)) == [6]
