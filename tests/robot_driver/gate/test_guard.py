"""What the last gate lets pass to the motors, and when it stops them by itself."""

import math
from random import Random
from typing import Any

import pytest

from cmr.model.duty_ramp import Limits, Ramp
from robot_driver.controllers import CONTROLLERS, Request
from robot_driver.encoders import Wiring
from robot_driver.gate.guard import CONFIRMING, LATE, LIFETIME, SILENCE, SLACK, UNSERVED, Guard, Mounting
from robot_driver.gate.messages import SECOND, Kind, Reason, Word
from robot_driver.gate.process import wire_of
from robot_driver.gate.wire_roboclaw import DRIVE_BOTH, RoboClawWire, packet

CYCLE = SECOND // 100
START = 1000 * SECOND


class Driver:
    """Sends words to a guard, as the driver does; it has given the controller its watchdog."""

    def __init__(self, kind: str = "roboclaw", mounting: Mounting = Mounting(), *, armed: bool = True) -> None:  # noqa: B008 - it is frozen
        self.disk = False
        self.wire = wire_of(kind)
        self.guard = Guard(self.wire, mounting, CYCLE, lambda: self.disk)
        self.controller = CONTROLLERS[kind]()
        self.now = START
        self.command = 0.0, 0.0
        self.expires = START + 100 * SECOND
        self.held = self.engaged = False
        if armed and self.wire.units:
            watchdog = self.controller.set_watchdog(0.5)
            assert self.send(watchdog.data) is None
            if watchdog.then is not None:
                assert self.send(watchdog.then(None).data) is None

    def word(self, data: bytes = b"") -> Word:
        expires = min(self.expires, self.now + LIFETIME)
        return Word(Kind.WRITE, 1, self.now, self.held, self.engaged, *self.command, expires, data)

    def send(self, data: bytes) -> Reason | None:
        word = self.word(data)
        return self.guard.take(word, self.now) or self.guard.judge(word, self.now)

    def drive(self, first: float, second: float) -> Reason | None:
        return self.send(self.controller.drive(first, second).data)

    def feed(self) -> Reason | None:
        return self.guard.take(self.word(), self.now)


KINDS = sorted(CONTROLLERS)


@pytest.mark.parametrize("kind", KINDS)
def test_every_request_of_the_driver_passes_and_the_command_too(kind: str) -> None:
    driver = Driver(kind, armed=False)
    controller = driver.controller
    watchdog = controller.set_watchdog(controller.watchdog_seconds)
    requests: list[Request[Any]] = [controller.identify(), *controller.learn(), watchdog, controller.read_watchdog()]
    requests += [controller.read_encoders(), *controller.read_telemetry(), *controller.stops()]
    for request in requests:
        if request.data:
            assert driver.send(request.data) is None, request.name
    if watchdog.then is not None:
        assert driver.send(watchdog.then(None).data) is None
    driver.command = 1.0, -1.0
    assert driver.drive(0.5, -0.5) is None
    assert driver.drive(1.0, -1.0) is None
    assert driver.guard.moving


@pytest.mark.parametrize("kind", KINDS)
def test_any_other_bytes_are_refused(kind: str) -> None:
    driver, chance = Driver(kind), Random(1)
    good = driver.controller.drive(0.0, 0.0).data
    for _ in range(2_000):
        bad = bytearray(good)
        bad[chance.randrange(len(bad))] ^= 1 << chance.randrange(8)
        reason = driver.send(bytes(bad))
        read = driver.wire.read(bytes(bad))
        assert reason is not None or not any(request.duty != (0.0, 0.0) for request in read or [] if request.duty)
        assert driver.send(chance.randbytes(chance.randrange(1, 40))) is Reason.FOREIGN
    assert driver.send(good + good[:1]) is Reason.FOREIGN


@pytest.mark.parametrize("command", [0, 4, 6, 35, 37, 52, 94])
def test_other_commands_of_a_controller_are_refused(command: int) -> None:
    assert Driver().send(packet(bytes((0x80, command)), b"\x10\x00\x10\x00")) is Reason.FOREIGN


@pytest.mark.parametrize("steps", [0, 6, 255])
def test_a_watchdog_that_would_stop_nothing_in_time_is_refused(steps: int) -> None:
    assert Driver().send(packet(b"\x80\x0e", bytes((steps,)))) is Reason.FOREIGN
    assert Driver("roboteq").send(b"^RWD %d\r" % (100 * steps)) is Reason.FOREIGN


@pytest.mark.parametrize("kind", ["roboclaw", "roboclaw-pair", "roboteq"])
def test_7_nothing_moves_before_every_unit_has_its_watchdog(kind: str) -> None:
    driver = Driver(kind, armed=False)
    driver.command = 0.5, 0.5
    assert driver.drive(0.1, 0.1) is Reason.UNARMED
    driver.send(driver.controller.set_watchdog(0.5).data)
    assert driver.drive(0.1, 0.1) is (Reason.UNARMED if kind == "roboclaw-pair" else None)
    driver.guard.opened()
    assert driver.drive(0.1, 0.1) is Reason.UNARMED


def test_nothing_moves_before_a_command_is_known() -> None:
    guard = Guard(RoboClawWire(), Mounting(), CYCLE, lambda: False)
    word = Driver().word(packet(bytes((0x80, DRIVE_BOTH)), b"\x10\x00\x10\x00"))
    assert guard.judge(word, START) is Reason.HELD


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, 1.001])
def test_18_a_command_that_is_none_does_not_move_and_leaves_the_last_one(wrong: float) -> None:
    driver = Driver()
    driver.command = 0.5, 0.5
    assert driver.feed() is None
    driver.command = 0.5, wrong
    assert driver.send(driver.controller.drive(0.5, 0.5).data) is Reason.INSANE
    driver.command = 0.5, 0.5
    assert driver.drive(0.5, 0.5) is None


def test_8_a_command_in_force_for_longer_than_half_a_second_is_none() -> None:
    driver = Driver()
    word = driver.word()._replace(expires=driver.now + LIFETIME + SECOND // 100)
    assert driver.guard.take(word, driver.now) is Reason.INSANE


def test_8_a_stale_command_drives_no_more_and_zero_always_passes() -> None:
    driver = Driver()
    driver.command, driver.expires = (0.5, 0.5), START + SECOND // 10
    assert driver.drive(0.5, 0.5) is None
    driver.now = driver.expires + CYCLE + 1
    assert driver.drive(0.5, 0.5) is Reason.STALE
    assert driver.drive(0.0, 0.0) is None
    assert not driver.guard.moving


@pytest.mark.parametrize("held", ["held", "engaged"])
def test_18_what_is_held_does_not_move_from_that_very_word_on(held: str) -> None:
    driver = Driver()
    driver.command = 0.5, 0.5
    assert driver.drive(0.5, 0.5) is None
    setattr(driver, held, True)
    assert driver.drive(0.5, 0.5) is Reason.HELD
    assert driver.guard.stop_due() == driver.now + CYCLE + SLACK
    assert driver.drive(0.0, 0.0) is None
    assert driver.guard.stop_due() is None


def test_a_word_that_waited_drives_nothing_but_zero() -> None:
    driver = Driver()
    driver.command = 0.5, 0.5
    assert driver.drive(0.5, 0.5) is None
    word = driver.word(driver.controller.drive(0.5, 0.5).data)
    later = driver.now + LATE + 1
    assert driver.guard.take(word, later) is Reason.LATE
    assert driver.guard.judge(word, later) is Reason.LATE
    assert driver.guard.judge(driver.word(driver.controller.drive(0.0, 0.0).data), later) is None
    early = driver.word()._replace(sent=driver.now + SECOND)
    assert driver.guard.take(early, driver.now) is Reason.LATE


@pytest.mark.parametrize("duty", [(0.4, 0.2), (-0.1, 0.2), (0.3, -0.2), (0.3, 0.31)])
def test_a_duty_beyond_what_is_commanded_or_against_it_does_not_pass(duty: tuple[float, float]) -> None:
    driver = Driver()
    driver.command = 0.3, 0.2
    assert driver.drive(*duty) is Reason.BEYOND
    assert driver.drive(0.3, 0.2) is None


def test_a_duty_may_shrink_on_its_way_but_not_grow_to_what_was_commanded_long_ago() -> None:
    driver = Driver()
    driver.command = 1.0, 1.0
    assert driver.drive(1.0, 1.0) is None
    driver.command = 0.1, -0.5
    assert driver.drive(0.9, 0.9) is None
    driver.now += LATE + 1
    assert driver.feed() is None
    driver.now += 1
    assert driver.drive(0.8, 0.7) is None
    assert driver.drive(0.9, 0.7) is Reason.BEYOND
    assert driver.drive(0.1, -0.5) is None


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("left", [False, True])
@pytest.mark.parametrize("right", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_8_the_driver_s_own_ramp_is_never_refused(kind: str, swap: bool, left: bool, right: bool) -> None:
    wiring, chance = Wiring(swap, left, right), Random(1)
    driver = Driver(kind, wiring.mounting)
    ramp = Ramp(Limits(), longest_step=0.02)
    for _ in range(300):
        driver.now += CYCLE
        if chance.random() < 0.2:
            driver.command = chance.uniform(-1.0, 1.0), chance.choice((-1.0, 0.0, 0.001, 1.0))
            driver.feed()
        duties = ramp.towards(*driver.command, driver.now / SECOND)
        if chance.random() < 0.2:  # another command comes before the duty is sent
            driver.command = chance.uniform(-1.0, 1.0), chance.uniform(-1.0, 1.0)
        assert driver.drive(*wiring.channels(*duties)) is None
        ramp.acknowledge()
        ramp.confirm()


def test_who_falls_silent_or_serves_no_motors_or_lets_a_command_expire_is_stopped() -> None:
    driver = Driver()
    driver.command = 0.5, 0.5
    assert driver.guard.stop_due() is None
    driver.drive(0.5, 0.5)
    assert driver.guard.stop_due() == START + SILENCE
    for _ in range(20):
        driver.now += SECOND // 50
        driver.feed()
    assert driver.guard.stop_due() == START + UNSERVED
    driver.drive(0.5, 0.5)
    driver.expires = driver.now + 1
    driver.feed()
    assert driver.guard.stop_due() == driver.now + 1 + CYCLE + SLACK


def test_after_an_intervention_the_driver_begins_from_zero() -> None:
    driver = Driver()
    driver.command = 0.5, 0.5
    driver.drive(0.5, 0.5)
    driver.guard.note_intervention()
    assert driver.guard.interventions == 1
    assert driver.drive(0.5, 0.5) is Reason.ZERO_FIRST
    assert driver.drive(0.0, 0.0) is None
    assert driver.drive(0.1, 0.1) is None


def test_a_driver_that_is_there_has_to_send_zero_itself_in_time() -> None:
    driver = Driver()
    driver.command, driver.expires = (0.5, 0.5), START + SECOND // 10
    driver.drive(0.5, 0.5)
    driver.now = due = driver.expires + CYCLE + SLACK
    assert driver.guard.stop_due() == due
    assert not driver.guard.is_attended(due)
    driver.feed()
    assert driver.guard.is_attended(due)
    driver.guard.note_intervention(due + CONFIRMING)
    assert driver.guard.stop_due() == due + CONFIRMING
    assert not driver.guard.is_attended(due), "not a second time"
    assert driver.drive(0.0, 0.0) is None
    assert driver.guard.stop_due() is None


def latched_driver() -> Driver:
    driver = Driver()
    driver.disk = True
    driver.guard = Guard(driver.wire, Mounting(), CYCLE, lambda: driver.disk)
    driver.command = 0.5, 0.5
    driver.send(driver.controller.set_watchdog(0.5).data)
    return driver


def test_19_a_stop_on_the_disk_holds_whatever_the_driver_says_until_it_confirms_and_releases_it() -> None:
    driver = latched_driver()
    assert driver.drive(0.1, 0.1) is Reason.HELD
    driver.held = True  # by the controller or the battery, which is no answer
    driver.feed()
    driver.held = False
    assert driver.drive(0.1, 0.1) is Reason.HELD
    driver.engaged = True
    assert driver.drive(0.1, 0.1) is Reason.HELD
    driver.engaged = False
    assert driver.drive(0.1, 0.1) is None
    assert not driver.guard.latched


def test_19_a_stop_that_is_on_the_disk_no_more_holds_no_more() -> None:
    driver = latched_driver()
    assert driver.drive(0.1, 0.1) is Reason.HELD
    driver.disk = False
    assert driver.drive(0.1, 0.1) is None
