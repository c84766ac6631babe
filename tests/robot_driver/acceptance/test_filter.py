"""The filter between driver and device: what it passes on, holds back, damages and forges."""

from itertools import pairwise

import pytest

from robot_driver.acceptance.dialects import DIALECTS, Dialect, Kind
from robot_driver.acceptance.filter import SECOND, Faults, Filter, Forgery, GyroFaults, GyroFilter
from robot_driver.controllers import CONTROLLERS

MS = 1_000_000  # ns


@pytest.fixture(params=sorted(DIALECTS))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def dialect(name: str) -> Dialect:
    return DIALECTS[name]()


def asked(line: Filter, now: int = 0) -> Filter:
    line.from_driver(line.dialect.ask_counts, now)
    return line


def test_a_dialect_knows_what_the_driver_asks(name: str, dialect: Dialect) -> None:
    controller = CONTROLLERS[name]()
    kinds = [
        dialect.kind(request.data)
        for request in (
            controller.drive(0.1, -0.1),
            controller.read_encoders(),
            controller.set_watchdog(0.5),
            controller.read_watchdog(),
            controller.read_telemetry()[0],
            controller.identify(),
        )
    ]
    assert kinds == [Kind.DRIVE, Kind.COUNTS, Kind.SET_WATCHDOG, Kind.WATCHDOG, Kind.VOLTAGE, Kind.OTHER]
    assert dialect.duty(controller.drive(0.1, -0.1).data) == pytest.approx((0.1, -0.1), abs=1e-4)
    assert dialect.watchdog_set(controller.set_watchdog(0.5).data) == 0.5
    assert controller.read_encoders().data == dialect.ask_counts


def test_what_is_forged_is_what_the_driver_understands(name: str, dialect: Dialect) -> None:
    controller = CONTROLLERS[name]()
    counts = 2**32 - 100, 7
    assert controller.read_encoders().parse(dialect.saying_counts(counts)) == counts
    assert dialect.counts(dialect.saying_counts(counts)) == counts
    assert controller.read_watchdog().parse(dialect.saying_watchdog(0.5)) == 0.5
    assert dialect.watchdog(dialect.saying_watchdog(0.5)) == 0.5
    voltage = controller.read_telemetry()[0].parse(dialect.saying_voltage(10.5))
    assert voltage == {"battery_voltage": 10.5}


def test_a_good_line_changes_nothing(dialect: Dialect) -> None:
    line = asked(Filter(dialect))
    reply = dialect.saying_counts((3, 4))
    (piece,) = line.from_device(reply, 5 * MS)
    assert piece == (5 * MS, False, reply)
    assert line.exchanges[-1].reply == line.exchanges[-1].delivered == reply


def test_a_reply_in_pieces_comes_byte_by_byte(dialect: Dialect) -> None:
    line = asked(Filter(dialect, faults=Faults(gap=5 * MS)))
    reply = dialect.saying_counts((3, 4))
    assert line.from_device(reply[:3], MS) == []
    pieces = line.from_device(reply[3:], 2 * MS)
    assert b"".join(piece.data for piece in pieces) == reply
    assert {after.due - before.due for before, after in pairwise(pieces)} == {5 * MS}


def test_no_reply_overtakes_one_that_is_late(dialect: Dialect) -> None:
    line = asked(Filter(dialect, faults=Faults(delay=1.0)))
    (late,) = line.from_device(dialect.saying_counts((3, 4)), MS)
    line.faults.delay = 0.0
    (prompt,) = asked(line, 20 * MS).from_device(dialect.saying_counts((5, 6)), 21 * MS)
    assert late.due <= prompt.due


def test_counts_are_shifted_over_the_end_of_the_counter(dialect: Dialect) -> None:
    line = asked(Filter(dialect, forgery=Forgery(offset=(2**32 - 1, 0))))
    (piece,) = line.from_device(dialect.saying_counts((3, 4)), MS)
    assert dialect.counts(piece.data) == (2, 4)
    assert dialect.counts(line.exchanges[-1].reply) == (3, 4)


def test_a_watchdog_is_lost_until_it_is_set_again(name: str, dialect: Dialect) -> None:
    controller = CONTROLLERS[name]()
    line = Filter(dialect, forgery=Forgery(watchdog_lost=True))

    def read() -> float | None:
        line.from_driver(controller.read_watchdog().data, 0)
        (piece,) = line.from_device(dialect.saying_watchdog(0.5), MS)
        return dialect.watchdog(piece.data)

    assert read() == 0.0
    line.from_driver(controller.set_watchdog(0.5).data, 0)
    assert read() == 0.5


def test_a_deaf_device_is_sent_bytes_without_sense_and_a_silent_one_says_nothing(dialect: Dialect) -> None:
    line = Filter(dialect, faults=Faults(deaf=True, silent=True))
    (piece,) = line.from_driver(dialect.ask_counts, 0)
    assert piece.data == bytes(len(dialect.ask_counts))
    assert line.from_device(dialect.saying_counts((3, 4)), MS) == []


def test_a_slow_line_takes_the_time_of_its_bytes(dialect: Dialect) -> None:
    line = Filter(dialect, faults=Faults(baud=2400))
    (request,) = line.from_driver(dialect.ask_counts, 0)
    assert request.due == len(dialect.ask_counts) * 10 * SECOND // 2400
    reply = dialect.saying_counts((3, 4))
    (piece,) = line.from_device(reply, request.due)
    assert piece.due > request.due + len(reply) * 10 * SECOND // 2400


def test_a_gyro_is_held_back_or_off_and_heard_all_the_same() -> None:
    line = GyroFilter(faults=GyroFaults(hold=50 * MS))
    assert [line.from_device(b"x", moment * MS)[0].due for moment in (1, 20, 60)] == [50 * MS, 50 * MS, 100 * MS]
    line.faults = GyroFaults(invalid=True)
    assert line.from_device(b"0.1 1\r\n", 70 * MS)[0].data == b"0.1 0\r\n"
    line.faults = GyroFaults(off=True)
    assert line.from_device(b"x", 80 * MS) == []
    assert len(line.heard) == 4
