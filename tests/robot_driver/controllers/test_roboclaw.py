"""RoboClaws as they come: firmware of any age, and two units on one line for four motors."""

import dataclasses
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import make, now_utime
from cmr.bus.streams import ESTOP, MOTOR_COMMAND, MOTOR_FEEDBACK
from cmr.msg import estop_t, motor_command_t, motor_feedback_t
from robot_driver.controllers import CONTROLLERS, Request
from robot_driver.controllers.roboclaw_pair import RoboClawPair
from robot_driver.driver import Driver
from robot_driver.emulator import settings as emulated
from robot_driver.emulator.device import Device
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.roboclaw_pair_device import RoboclawPairDevice
from robot_driver.gate.wire_roboclaw import crc
from robot_driver.settings import Settings
from robot_driver.terminals.pseudo_terminal import Ports
from tests.support.driver_bench import PunctualEngine, open_gate_of, wait_for
from tests.support.exchanges import Exchanges

pytestmark = pytest.mark.real_time

SAVE_TO_MEMORY = 94
NEVER = 60.0  # s; longer than a test lasts
COMMANDED_ON = 0.3  # s for which a robot that has been stopped goes on being commanded


class Run:
    """A driver that is running, and what it published."""

    def __init__(self, driver: Driver) -> None:
        self.driver = driver
        self.feedback: list[Any] = []

    def until(self, condition: Callable[[], object], left: float = 0.5, right: float = -0.25) -> None:
        """Command the same duties until the condition holds."""

        def commanded() -> object:
            command = make(motor_command_t, utime=now_utime(), robot_id=0, left=left, right=right)
            self.driver.handle(command.utime, MOTOR_COMMAND.channel(0), command)
            self.feedback += [message for stream, _, message in self.driver.outgoing() if stream is MOTOR_FEEDBACK]
            return condition()

        wait_for(commanded)


@contextmanager
def running(folder: Path, controller: str, plant: Plant, device: Device) -> Iterator[Run]:
    with (
        Ports(folder, ("motor",)) as ports,
        PunctualEngine(plant, {"motor": device}, ports.terminals),
        Driver(Settings(port=str(folder / "motor"), controller=controller)) as driver,
    ):
        open_gate_of(driver)
        yield Run(driver)


def pair() -> tuple[Plant, RoboclawPairDevice]:
    plant = Plant(emulated.load_settings().ideal())
    return plant, RoboclawPairDevice(emulated.load_settings().ideal(), plant)


def deafen(unit: RoboclawDevice) -> None:
    """Have a unit hear nothing more."""
    unit.receive = lambda data, time: []  # type: ignore[method-assign]  # noqa: ARG005


def endure_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the driver not give up its connection for want of answers."""
    monkeypatch.setattr("robot_driver.motors.SILENCE_LIMIT", NEVER)
    monkeypatch.setattr("robot_driver.readings.OLDEST", NEVER)


def reply_of(unit: int, command: int, data: bytes) -> bytes:
    return data + struct.pack(">H", crc(bytes((unit, command)) + data))


@pytest.mark.parametrize("status_bytes", [1, 2, 4])
def test_firmware_of_any_age_is_understood_from_the_first_connection(
    tmp_path: Path, status_bytes: int, exchanges: Exchanges
) -> None:
    settings = emulated.load_settings().ideal()
    settings = dataclasses.replace(settings, roboclaw=dataclasses.replace(settings.roboclaw, status_bytes=status_bytes))
    plant = Plant(settings)
    with running(tmp_path, "roboclaw", plant, RoboclawDevice(settings, plant)) as run:
        run.until(lambda: len(run.feedback) > 15)
        exchanges.assert_only_stalls_failed()
        assert run.driver.problems() == ""
        assert run.feedback[-1].status == 0


def test_two_units_drive_four_motors_and_measure_the_mean_of_each_side(tmp_path: Path, exchanges: Exchanges) -> None:
    plant, device = pair()
    with running(tmp_path, "roboclaw-pair", plant, device) as run:
        run.until(lambda: run.feedback and run.feedback[-1].ticks_left > 200)
        assert [unit.duty for unit in device.units] == [[16384, -8192], [16384, -8192]]
        assert run.feedback[-1].ticks_right < -50
        assert run.feedback[-1].battery_voltage == 12.4
        exchanges.assert_only_stalls_failed()
    assert [unit.duty for unit in device.units] == [[0, 0], [0, 0]]


def test_13_counts_go_on_where_the_registers_wrap_upwards_and_downwards(tmp_path: Path) -> None:
    settings = emulated.load_settings().ideal()
    plant = Plant(settings)
    device = RoboclawDevice(settings, plant)
    device.board.encoder_zero = [10, -10]
    assert device.board.encoders() == (2**32 - 10, 10)
    with running(tmp_path, "roboclaw", plant, device) as run:
        run.until(lambda: run.feedback and run.feedback[-1].ticks_left > 200 and run.feedback[-1].ticks_right < -100)
        assert device.board.encoders()[0] < 2**16 < 2**31 < device.board.encoders()[1]
        assert run.driver._motors.jumps == 0
    ticks = [(message.ticks_left, message.ticks_right) for message in run.feedback]
    assert 0 <= ticks[0][0] < 10  # the registers wrap later; a wheel may have begun to turn
    assert -10 < ticks[0][1] <= 0
    assert [pair[0] for pair in ticks] == sorted(pair[0] for pair in ticks)
    assert [pair[1] for pair in ticks] == sorted((pair[1] for pair in ticks), reverse=True)


@pytest.mark.parametrize("dead", [0, 1])
def test_when_one_of_two_units_falls_silent_the_other_is_stopped(tmp_path: Path, dead: int) -> None:
    plant, device = pair()
    with running(tmp_path, "roboclaw-pair", plant, device) as run:
        run.until(lambda: device.units[1 - dead].duty == [16384, -8192])
        deafen(device.units[dead])
        run.until(lambda: "0x80 and 0x81" in run.driver.problems())
        run.until(lambda: device.units[1 - dead].duty == [0, 0])
        later = time.monotonic() + COMMANDED_ON
        run.until(lambda: time.monotonic() > later)
        assert device.units[1 - dead].duty == [0, 0]
        assert "0x80 and 0x81" in run.driver.problems()


@pytest.mark.parametrize("dead", [0, 1])
def test_while_one_of_two_units_is_silent_the_other_goes_on_obeying(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dead: int
) -> None:
    endure_silence(monkeypatch)
    monkeypatch.setattr("robot_driver.motors.HUSH", NEVER)
    plant, device = pair()
    with running(tmp_path, "roboclaw-pair", plant, device) as run:
        run.until(lambda: device.units[1 - dead].duty == [16384, -8192])
        deafen(device.units[dead])
        run.until(lambda: device.units[1 - dead].duty[0] < 16384, 0.25, -0.25)
        assert device.units[1 - dead].duty[1] != 0
        estop = make(estop_t, utime=now_utime(), engaged=True, source="test", reason="test")
        run.driver.handle(estop.utime, ESTOP.channel(), estop)
        run.until(lambda: device.units[1 - dead].duty == [0, 0])
        assert run.driver.problems() == ""


@pytest.mark.parametrize("dead", [0, 1])
def test_soon_after_one_of_two_units_fell_silent_the_other_is_told_zero_until_both_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dead: int
) -> None:
    endure_silence(monkeypatch)
    plant, device = pair()
    with running(tmp_path, "roboclaw-pair", plant, device) as run:
        run.until(lambda: device.units[1 - dead].duty == [16384, -8192])
        deafen(device.units[dead])
        run.until(lambda: device.units[1 - dead].duty == [0, 0])
        later = time.monotonic() + COMMANDED_ON
        run.until(lambda: time.monotonic() > later)
        assert device.units[1 - dead].duty == [0, 0]
        del device.units[dead].receive
        run.until(lambda: [unit.duty for unit in device.units] == [[16384, -8192], [16384, -8192]])
        assert run.driver.problems() == ""


def test_when_one_of_two_units_is_reset_both_are_armed_anew(tmp_path: Path) -> None:
    plant, device = pair()
    with running(tmp_path, "roboclaw-pair", plant, device) as run:
        run.until(lambda: device.units[1].duty == [16384, -8192])
        device.units[1].board.timeout = 0.0
        run.until(lambda: "was reset" in run.driver.problems())
        run.until(lambda: run.driver.problems() == "")
        assert device.units[1].board.timeout == pytest.approx(0.5)


def test_the_counters_of_two_units_wrap_each_for_itself() -> None:
    both = RoboClawPair()

    def read(front: tuple[int, int], rear: tuple[int, int]) -> tuple[int, int]:
        request = both.read_encoders()
        assert request.then is not None
        further = request.then(request.parse(reply_of(0x80, 78, struct.pack(">II", *front))))
        assert further.data == bytes((0x81, 78))
        return further.parse(reply_of(0x81, 78, struct.pack(">II", *rear)))

    left, right = read((2**32 - 10, 5), (700, 2**31))
    assert (left, right) == (345, 3 * 2**30 + 2)
    assert read((0, 3), (720, 2**31 - 4)) == (left + 15, right - 3)


@pytest.mark.parametrize("name", ["roboclaw", "roboclaw-pair"])
def test_nothing_is_ever_written_to_the_memory_of_a_device(name: str) -> None:
    controller = CONTROLLERS[name]()
    requests: list[Request[Any]] = [
        controller.identify(),
        *controller.learn(),
        controller.set_watchdog(0.5),
        controller.read_watchdog(),
        *controller.stops(),
        controller.read_encoders(),
        *controller.read_telemetry(),
    ]
    commands = {request.data[1] for request in requests}
    assert SAVE_TO_MEMORY not in commands
    assert commands == {21, 90, 14, 15, 34, 78, 24, 49, 82}


def test_a_status_of_either_unit_is_told() -> None:
    both = RoboClawPair()
    request = both.read_telemetry()[-1]
    assert request.then is not None
    quiet = request.parse(reply_of(0x80, 90, bytes(4)))
    assert request.then(quiet).parse(reply_of(0x81, 90, b"\0\0\0\1")) == {"status": motor_feedback_t.STATUS_ESTOP}
