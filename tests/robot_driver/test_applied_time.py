"""`applied_utime` of MOTOR_FEEDBACK is when the controller had the duty, whatever it is asked besides."""

import math
from itertools import pairwise, product

import pytest

from robot_driver.emulator.device import Transmission
from robot_driver.emulator.devices import CONTROLLER_DEVICES
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from robot_driver.gate.wire_roboclaw import DRIVE_BOTH, FULL_DUTY
from robot_driver.motors import PROBES, SLOWEST_ADAPTER
from robot_driver.serial_port import USB_FRAME
from tests.robot_driver.simulated_line import Bench, Clock, clock

pytestmark = pytest.mark.real_time

__all__ = ["clock"]
CLOCKS = 50e-6  # s within which the clock of the test and the time of day are compared
ANSWER = 0.5 * 10 / 115200  # s; half of the time of an answer's first byte on the wire


HELD = 0.016  # s; how often a USB adapter passes on what it holds


def held(_data: bytes, answers: list[Transmission]) -> list[Transmission]:
    """What is said, as an adapter passes it on."""
    return [Transmission(HELD * math.ceil(one.time / HELD), one.data) for one in answers]


@pytest.mark.parametrize(("controller", "holds"), [*product(("roboclaw", "roboteq", "mbot"), (False, True))])
def test_a_duty_is_said_to_be_in_force_from_when_the_controller_had_it(
    controller: str, holds: bool, clock: Clock
) -> None:
    settings = load_settings().ideal()
    bench = Bench(controller, CONTROLLER_DEVICES[controller](settings, Plant(settings)), clock)
    if holds:
        bench.line.after = held
    bench.connect()
    bench.wanted = (0.0, 0.0)
    bench.turns(2)
    bench.line.driven.clear()
    bench.feedback.clear()
    bench.wanted = (1.0, 1.0)
    told = []
    for _ in range(5):  # on its ramp each duty is another one
        bench.turns(1)
        message = bench.feedback[-1]
        told.append(message.applied_utime - clock.utime_at(clock.monotonic_ns()) + 1e6 * clock.now)
    driven = [moment for moment, duty in bench.line.driven if any(duty)]
    assert len(driven) == len(told)
    # How long a controller takes to answer is known to a frame of USB and a probe.
    within = ANSWER + CLOCKS + (0.5 * (SLOWEST_ADAPTER / PROBES + 1e-9 * USB_FRAME) if holds else 0.0)
    assert [1e-6 * time for time in told] == pytest.approx(driven, abs=within)


def test_a_duty_whose_answer_is_lost_is_told_nevertheless(clock: Clock) -> None:
    settings = load_settings().ideal()
    bench = Bench("roboclaw", CONTROLLER_DEVICES["roboclaw"](settings, Plant(settings)), clock)
    bench.connect()
    bench.wanted = (0.0, 0.0)
    bench.turns(2)
    bench.line.driven.clear()
    bench.feedback.clear()
    bench.duties.clear()
    bench.wanted = (1.0, 1.0)
    bench.turns(2)
    loses = [True]

    def after(data: bytes, answers: list[Transmission]) -> list[Transmission]:
        return [] if data[1:2] == bytes((DRIVE_BOTH,)) and loses and loses.pop() else answers

    bench.line.after = after
    bench.turns(6)
    told = [(message.applied_utime, message.applied_left) for message in bench.feedback]
    told += [(message.utime, message.sent_left) for message in bench.duties]
    assert len(bench.duties) == 2  # that without an answer, and the first of two after it
    in_force = [(moment, duty[0] / FULL_DUTY) for moment, duty in bench.line.driven]
    utime_of_zero = clock.utime_at(clock.monotonic_ns()) - 1e6 * clock.now
    seen = [(1e-6 * (utime - utime_of_zero), duty) for utime, duty in sorted(told)]
    changes = [seen[0], *(after for before, after in pairwise(seen) if after[1] != before[1])]
    assert [duty for _, duty in changes] == pytest.approx([duty for _, duty in in_force], abs=1e-4)
    assert [time for time, _ in changes] == pytest.approx([time for time, _ in in_force], abs=1e-3)
