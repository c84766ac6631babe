"""Whatever is lost, late or damaged: never two steps of the ramp in one, and never a duty that is out of date."""

from collections.abc import Callable

import pytest

from cmr.model.duty_ramp import Limits, Ramp
from robot_driver.command_gate import Stop
from robot_driver.emulator.device import Transmission
from robot_driver.emulator.mbot_device import MBotDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.settings import load_settings
from robot_driver.gate.wire_roboclaw import DRIVE_BOTH, READ_WATCHDOG
from robot_driver.serial_port import PortLost
from tests.robot_driver.simulated_line import Bench, Clock, clock, steepest

assert clock  # a fixture

FULL_DUTY = 32767
FULL = (1.0, -1.0)  # as an MBot has it, whose right wheel is mirrored
STEP = 0.2  # what a duty may grow by at once: 10 per s, in two periods
ROUNDING = 1e-4
ACKNOWLEDGED = b"\xff"
ANSWER_LIKE_AN_ACKNOWLEDGEMENT = bytes.fromhex("ffd3ffb4e158")


class ResettableMBot(MBotDevice):
    """A board whose supply dips: for a while it hears and says nothing, and knows nothing of the past afterwards."""

    deaf_until = 0.0

    def reset(self, until: float) -> None:
        self.deaf_until = until
        self._is_told_time, self._commanded, self._waiting = False, (0.0, 0.0), b""
        self._drive((0.0, 0.0))

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        return super().receive(data, time) if time > self.deaf_until else []


def roboclaw(clock: Clock, rate_hz: float = 100.0) -> Bench:
    """A RoboClaw that was commanded zero and then full duty, and is on its way there."""
    settings = load_settings().ideal()
    bench = Bench("roboclaw", RoboclawDevice(settings, Plant(settings)), clock, rate_hz)
    bench.connect()
    bench.wanted = (0.0, 0.0)
    bench.turns(1)
    bench.wanted = (1.0, 1.0)
    return bench


def unconnected_mbot(clock: Clock) -> tuple[Bench, ResettableMBot]:
    settings = load_settings().ideal()
    device = ResettableMBot(settings, Plant(settings))
    device.wake_time = clock.now
    return Bench("mbot", device, clock), device


def mbot(clock: Clock) -> tuple[Bench, ResettableMBot]:
    """An MBot at full duty."""
    bench, device = unconnected_mbot(clock)
    bench.connect()
    bench.wanted = (0.0, 0.0)
    bench.turns(1)
    bench.wanted = (1.0, 1.0)
    bench.until(lambda: device.duty == FULL)
    return bench, device


def duties(bench: Bench) -> list[tuple[float, tuple[float, float]]]:
    return [(time, (left / FULL_DUTY, right / FULL_DUTY)) for time, (left, right) in bench.line.driven]


def is_duty(data: bytes) -> bool:
    return data[1:2] == bytes((DRIVE_BOTH,)) and data[2:6] != bytes(4)


def once(bench: Bench, happens: Callable[[], None]) -> None:
    """Lose the next duty that is sent, and do something at that moment."""

    def lose(data: bytes) -> bytes:
        if not is_duty(data):
            return data
        bench.line.before = lambda data: data
        happens()
        return b""

    bench.line.before = lose


def test_the_bench_drives_up_the_ramp(clock: Clock) -> None:
    bench = roboclaw(clock)
    bench.until(lambda: bench.line.device.duty == [FULL_DUTY, FULL_DUTY])
    assert 0.09 < steepest(duties(bench)) < 0.11


def test_an_acknowledgement_that_may_be_of_another_duty_is_no_licence_to_take_two_steps_in_one(clock: Clock) -> None:
    bench = roboclaw(clock)
    bench.until(lambda: duties(bench)[-1][1][0] > 0.25)
    once(bench, lambda: once(bench, lambda: bench.line.noise(ACKNOWLEDGED, 0.001)))
    bench.turns(3)
    assert bench.motors.faults == 1
    assert 0.11 < steepest(duties(bench)) < STEP + ROUNDING


def test_an_answer_that_only_begins_like_an_acknowledgement_is_no_licence_to_take_two_steps_in_one(
    clock: Clock,
) -> None:
    bench = roboclaw(clock)
    bench.until(lambda: duties(bench)[-1][1][0] > 0.25)
    once(bench, lambda: bench.line.noise(ANSWER_LIKE_AN_ACKNOWLEDGEMENT, 0.001))
    bench.turns(3)
    assert bench.motors.faults == 1
    assert 0.11 < steepest(duties(bench)) < STEP + ROUNDING


def test_in_doubt_a_duty_that_grew_is_not_built_upon_and_one_that_shrank_is() -> None:
    ramp = Ramp(Limits(10.0, 20.0), longest_step=0.02)
    for turn in range(6):
        ramp.towards(1.0, -1.0, 5.0 + 0.01 * turn)
        ramp.confirm()
    assert ramp.towards(1.0, -0.3, 5.06) == pytest.approx((0.6, -0.3))
    ramp.acknowledge()
    assert ramp.towards(1.0, -1.0, 5.07) == pytest.approx((0.7, -0.4))
    ramp.acknowledge()
    assert ramp.towards(1.0, -1.0, 5.08) == pytest.approx((0.7, -0.5))


def test_in_doubt_about_its_sign_a_duty_counts_as_zero() -> None:
    ramp = Ramp(Limits(10.0, 20.0), longest_step=0.02)
    for turn in range(2):
        ramp.towards(1.0, 1.0, 5.0 + 0.01 * turn)
        ramp.confirm()
    assert ramp.towards(-1.0, 1.0, 5.02) == pytest.approx((-0.05, 0.2))
    ramp.acknowledge()
    assert ramp.towards(-1.0, 1.0, 5.03) == pytest.approx((-0.1, 0.3))


def test_what_is_wanted_while_the_line_is_being_cleared_is_what_is_sent(clock: Clock) -> None:
    bench = roboclaw(clock)
    bench.until(lambda: bench.line.device.duty == [FULL_DUTY, FULL_DUTY])
    for piece in range(8):
        bench.line.noise(b"?", 0.009 * piece)
    clock.at = [(clock.now + 0.05, lambda: bench.gate.hold(Stop.BUS))]
    began = len(bench.line.said)
    bench.turn()
    assert clock.at == []
    assert next(data[2:6] for _, data in bench.line.said[began:] if data[1] == DRIVE_BOTH) == bytes(4)


def test_a_duty_that_was_held_up_before_it_was_sent_is_not_sent_any_more(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = roboclaw(clock)
    bench.until(lambda: bench.line.device.duty == [FULL_DUTY, FULL_DUTY])
    drive = bench.gate.drive

    def held_up(now: float) -> object:
        wanted = drive(now)
        monkeypatch.setattr(bench.gate, "drive", drive)
        clock.go_on(clock.now + 10.0)  # as when the process is stopped, or the computer suspended
        return wanted

    monkeypatch.setattr(bench.gate, "drive", held_up)
    began = len(bench.line.said)
    with pytest.raises(PortLost):
        bench.turn()
    assert bench.motors.faults == 1
    assert not any(is_duty(data) for _, data in bench.line.said[began:])


@pytest.mark.parametrize("silence", [0.11, 0.2, 0.35])
def test_an_mbot_that_was_reset_and_kept_its_port_is_driven_from_zero(clock: Clock, silence: float) -> None:
    for part in range(0, 26, 5):  # of the quarter of a second after which it is told the time again
        bench, device = mbot(clock)
        bench.turns(part)
        count = len(bench.line.driven)
        device.reset(clock.now + silence)
        bench.until(lambda: device.duty == FULL)  # noqa: B023 - it is called at once
        assert bench.line.driven[count][1] == (0.0, 0.0)
        assert steepest(bench.line.driven[count:]) < STEP + ROUNDING


def test_an_mbot_that_went_on_talking_while_the_driver_was_held_up_is_driven_on(clock: Clock) -> None:
    bench, device = mbot(clock)
    count = len(bench.line.driven)
    clock.go_on(clock.now + 0.3)
    bench.turns(10)
    assert device.duty == FULL
    assert bench.line.driven[count:] == []


@pytest.mark.parametrize("moment", [0.05, 0.5, 0.95, 1.05])
def test_9_an_mbot_whose_watchdog_is_being_watched_is_told_zero_promptly_when_the_process_ends(
    clock: Clock, moment: float
) -> None:
    bench, device = unconnected_mbot(clock)
    ending = clock.now + moment
    clock.at = [(ending, bench.stop.set)]
    with pytest.raises(PortLost, match="ending"):
        bench.connect()
    bench.motors.leave()
    assert bench.motors.rest == 0.0  # acknowledged
    assert bench.line.said[-1][0] >= ending
    assert clock.now < ending + 0.25
    assert device.duty == (0.0, 0.0)


def test_at_a_low_rate_one_lost_answer_does_not_stop_the_motors(clock: Clock) -> None:
    bench = roboclaw(clock, rate_hz=5.0)
    bench.until(lambda: bench.line.device.duty == [FULL_DUTY, FULL_DUTY])
    count = len(bench.line.driven)
    lost: list[bytes] = []

    def lose(data: bytes, answers: list[Transmission]) -> list[Transmission]:
        if lost or data[1:2] != bytes((READ_WATCHDOG,)):
            return answers
        lost.append(data)
        return []

    bench.line.after = lose
    bench.turns(10)
    assert len(lost) == bench.motors.faults == 1
    assert bench.line.driven[count:] == []


def test_at_a_low_rate_a_controller_that_was_reset_between_two_turns_is_armed_before_it_is_driven(
    clock: Clock,
) -> None:
    bench = roboclaw(clock, rate_hz=5.0)
    bench.until(lambda: bench.line.device.duty == [FULL_DUTY, FULL_DUTY])
    bench.line.device.board.switch_on()
    began = len(bench.line.said)
    with pytest.raises(PortLost, match="was reset"):
        bench.turn()
    assert not any(is_duty(data) for _, data in bench.line.said[began:])
