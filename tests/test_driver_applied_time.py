"""`applied_utime` of MOTOR_FEEDBACK is when the controller had the duty, whatever it is asked besides."""

import math

import pytest

from robot_driver.emulator.device import Transmission
from robot_driver.emulator.devices import CONTROLLER_DEVICES
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from tests.simulated_line import Bench, Clock, clock

__all__ = ["clock"]
CLOCKS = 50e-6  # s within which the clock of the test and the time of day are compared
ANSWER = 0.5 * 10 / 115200  # s; half of the time of an answer's first byte on the wire


HELD = 0.016  # s; how often a USB adapter passes on what it holds


def held(_data: bytes, answers: list[Transmission]) -> list[Transmission]:
    """What is said, as an adapter passes it on."""
    return [Transmission(HELD * math.ceil(one.time / HELD), one.data) for one in answers]


@pytest.mark.parametrize(
    ("controller", "holds"), [("roboclaw", False), ("roboteq", False), ("mbot", False), ("mbot", True)]
)
def test_a_duty_is_said_to_be_in_force_from_when_the_controller_had_it(
    controller: str, holds: bool, clock: Clock
) -> None:
    settings = load_settings().ideal()
    bench = Bench(controller, CONTROLLER_DEVICES[controller](settings, Plant(settings)), clock)
    if holds:  # the board stamps what it says by a clock of its own
        bench.line.after = held
    bench.connect()
    bench.wanted = (0.0, 0.0)
    bench.turns(2)
    bench.line.driven.clear()
    bench.feedback.clear()
    bench.wanted = (1.0, 1.0)
    told = []
    for _ in range(6):  # on its ramp each duty is another one
        bench.turns(1)
        message = bench.feedback[-1]
        told.append(message.applied_utime - clock.utime_at(clock.monotonic_ns()) + 1e6 * clock.now)
    driven = [moment for moment, duty in bench.line.driven if any(duty)]
    assert len(driven) == len(told)
    assert [1e-6 * time for time in told] == pytest.approx(driven, abs=ANSWER + CLOCKS)
