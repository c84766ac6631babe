"""The emulated RoboClaws, one or two on a line, tell a client that nobody here wrote exactly what is true of the robot.

The client is `basicmicro`, the maker's own Python library; it writes each packet in pieces, as the real devices bear.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from basicmicro import Basicmicro
from basicmicro.exceptions import PacketTimeoutError

from robot_driver.emulator.boards.roboclaw import FULL_DUTY
from robot_driver.emulator.boards.roboclaw_commands import VERSION
from robot_driver.emulator.device import Device, Transmission
from robot_driver.emulator.engine import Engine
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.roboclaw_pair_device import ADDRESSES, RoboclawPairDevice
from robot_driver.emulator.settings import Settings, load_settings
from robot_driver.terminals.pseudo_terminal import Ports
from tests.support.driver_bench import wait_for

pytestmark = pytest.mark.waits

FRONT, REAR = ADDRESSES
NOBODY = 0x82
PATIENCE = 1.0  # s between the bytes of an answer; a busy machine looks away
RETRIES = 5
DUTY = (12000, -7000)


@dataclasses.dataclass(frozen=True)
class Truth:
    """How the robot is, in the units of the wire, unsigned as the client leaves them."""

    milliseconds: int
    counts: tuple[int, int]
    speeds: tuple[int, int]  # counts/s
    currents: tuple[int, int]  # 10 mA
    battery: int  # 0.1 V
    duties: tuple[int, int]  # what turns the wheels

    @classmethod
    def of(cls, plant: Plant) -> "Truth":
        left, right = plant.left.duty, plant.right.duty
        return cls(
            round(1000.0 * plant.time),
            _pair(math.floor(count) % 2**32 for count in plant.encoder_counts()),
            _pair(round(speed) % 2**32 for speed in plant.encoder_speeds()),
            _pair(round(100.0 * current) for current in plant.motor_currents()),
            round(10.0 * plant.battery_voltage()),
            (round(FULL_DUTY * left), round(FULL_DUTY * right)),
        )


def _pair(numbers: Iterator[int]) -> tuple[int, int]:
    first, second = numbers
    return first, second


class Witness:
    """Stands by `device` and notes how the robot is whenever it answers."""

    def __init__(self, device: Device, plant: Plant) -> None:
        self.truth = Truth.of(plant)
        self.byte_time = device.byte_time
        self._device = device
        self._plant = plant

    @property
    def wake_time(self) -> float:
        return self._device.wake_time

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        answers = self._device.receive(data, time)
        if answers:
            self.truth = Truth.of(self._plant)
        return answers

    def wake(self, time: float) -> list[Transmission]:
        return self._device.wake(time)


@contextmanager
def client_of(folder: Path, device: Device, plant: Plant, retries: int = RETRIES) -> Iterator[Basicmicro]:
    client = Basicmicro(str(folder / "motor"), 115200, timeout=PATIENCE, retries=retries)
    with Ports(folder, ("motor",)) as ports, Engine(plant, {"motor": device}, ports.terminals) as engine:
        assert client.Open()
        yield client
        client.close()
        engine.check()


def emulated(**roboclaw: Any) -> tuple[Settings, Plant]:
    """Return a robot whose battery sags and whose motors do not run smoothly, so that every number changes."""
    settings = load_settings()
    changed = dataclasses.replace(settings, roboclaw=dataclasses.replace(settings.roboclaw, **roboclaw))
    delay = dataclasses.replace(settings.imperfections.command_delay, enabled=False)
    changed = dataclasses.replace(
        changed, imperfections=dataclasses.replace(settings.imperfections, command_delay=delay)
    )
    return changed, Plant(changed)


def backward(number: int) -> bool:
    return number >= 2**31


# What each call of the client is to return, behind its True.
READINGS: dict[str, Callable[[Truth], tuple[object, ...]]] = {
    "ReadVersion": lambda _: (VERSION[:-1].decode(),),
    "GetEncoders": lambda truth: truth.counts,
    "ReadEncM1": lambda truth: (truth.counts[0], 2 * backward(truth.speeds[0])),
    "ReadEncM2": lambda truth: (truth.counts[1], 2 * backward(truth.speeds[1])),
    "ReadSpeedM1": lambda truth: (truth.speeds[0], backward(truth.speeds[0])),
    "ReadSpeedM2": lambda truth: (truth.speeds[1], backward(truth.speeds[1])),
    "ReadISpeedM1": lambda truth: (truth.speeds[0], backward(truth.speeds[0])),
    "ReadISpeedM2": lambda truth: (truth.speeds[1], backward(truth.speeds[1])),
    "GetISpeeds": lambda truth: truth.speeds,
    "ReadPWMs": lambda truth: truth.duties,
    "ReadCurrents": lambda truth: truth.currents,
    "ReadMainBatteryVoltage": lambda truth: (truth.battery,),
    "ReadLogicBatteryVoltage": lambda _: (50,),
    "ReadTemp": lambda _: (315,),
    "ReadTemp2": lambda _: (315,),
    "ReadError": lambda _: (0,),
    "ReadBuffers": lambda _: (0x80, 0x80),
    "GetStatus": lambda truth: (
        *(truth.milliseconds, 0, 315, 315, truth.battery, 50),
        *(number % 2**16 for number in (*truth.duties, *truth.currents)),
        *(*truth.counts, 0, 0, *truth.speeds, 0, 0, 0, 0),
    ),
}


def test_everything_the_client_can_ask_is_what_is_true_while_the_robot_speeds_up(tmp_path: Path) -> None:
    settings, plant = emulated()
    witness, seen = Witness(RoboclawDevice(settings, plant), plant), set()
    with client_of(tmp_path, witness, plant) as client:
        assert client.DutyM1M2(FRONT, *DUTY)
        for _ in range(5):
            for name, expected in READINGS.items():
                said = getattr(client, name)(FRONT)
                assert (name, *said) == (name, True, *expected(witness.truth))
            seen.add(witness.truth)
    assert len({(truth.counts, truth.speeds, truth.currents, truth.battery) for truth in seen}) == 5


def test_each_motor_is_driven_for_itself_and_encoders_are_reset(tmp_path: Path) -> None:
    settings, plant = emulated()
    witness = Witness(RoboclawDevice(settings, plant), plant)
    with client_of(tmp_path, witness, plant) as client:
        assert client.DutyM1(FRONT, 9000)
        assert witness.truth.duties == (9000, 0)
        assert client.DutyM2(FRONT, -32767)
        assert witness.truth.duties == (9000, -32767)
        assert client.ResetEncoders(FRONT)
        zero = witness.truth.counts
        _, *counts = client.GetEncoders(FRONT)
        moved = [(now - then) % 2**32 for then, now in zip(zero, witness.truth.counts, strict=True)]
        assert counts == moved


@pytest.mark.parametrize("seconds", [0.0, 0.1, 0.5, 25.5])
def test_the_timeout_that_is_set_is_read_back(tmp_path: Path, seconds: float) -> None:
    settings, plant = emulated()
    with client_of(tmp_path, RoboclawDevice(settings, plant), plant) as client:
        assert client.SetTimeout(FRONT, seconds)
        assert client.GetTimeout(FRONT) == (True, seconds)


def test_two_units_on_one_line_are_told_apart(tmp_path: Path) -> None:
    settings, plant = emulated()
    device = RoboclawPairDevice(settings, plant)
    witness = Witness(device, plant)
    with client_of(tmp_path, witness, plant) as client:
        assert client.DutyM1M2(FRONT, 8000, -4000)
        assert client.DutyM1M2(REAR, 6000, -2000)
        assert [unit.duty for unit in device.units] == [[8000, -4000], [6000, -2000]]
        assert witness.truth.duties == (7000, -3000)  # the wheels of a side are coupled by the ground
        assert client.ReadPWMs(FRONT) == (True, 8000, -4000)
        assert client.ReadPWMs(REAR) == (True, 6000, -2000)
        for address in ADDRESSES:
            assert client.ReadVersion(address) == (True, VERSION[:-1].decode())
            assert client.GetEncoders(address) == (True, *witness.truth.counts)
            assert client.ReadCurrents(address) == (True, *witness.truth.currents)
        assert client.SetTimeout(REAR, 0.5)
        assert [client.GetTimeout(address) for address in ADDRESSES] == [(True, 0.0), (True, 0.5)]


@pytest.mark.parametrize(
    ("call", "arguments", "speeds"),
    [
        ("SpeedM1", (1500,), (1500, 0)),
        ("SpeedM2", (-1500,), (0, -1500)),
        ("SpeedM1M2", (2000, -1000), (2000, -1000)),
        ("SpeedAccelM1", (5000, 1500), (1500, 0)),
        ("SpeedAccelM2", (5000, -1500), (0, -1500)),
        ("SpeedAccelM1M2", (5000, 2000, -1000), (2000, -1000)),
        ("SpeedAccelM1M2_2", (5000, 2000, 2500, -1000), (2000, -1000)),
        ("SpeedM1M2", (2**31 - 1, -(2**31)), (6036, -6036)),  # one motor can do 2.5 % more, the other less
    ],
)
def test_the_wheels_turn_as_fast_as_the_client_says(
    tmp_path: Path, call: str, arguments: tuple[int, ...], speeds: tuple[int, int]
) -> None:
    settings, plant = emulated(baud=0)
    with client_of(tmp_path, RoboclawDevice(settings.ideal(), plant), plant) as client:
        assert getattr(client, call)(FRONT, *arguments)

        def missed_by() -> int:
            _, *unsigned = client.GetISpeeds(FRONT)
            said = [(speed + 2**31) % 2**32 - 2**31 for speed in unsigned]
            return int(max(abs(one - other) for one, other in zip(said, speeds, strict=True)))

        wait_for(lambda: missed_by() < 300)


def test_ramps_of_duties_counts_and_constants_are_as_the_client_sets_them(tmp_path: Path) -> None:
    settings, plant = emulated()
    device = RoboclawDevice(settings, plant)
    with client_of(tmp_path, device, plant) as client:
        assert client.SetEncM1(FRONT, 123456)
        assert client.SetEncM2(FRONT, 2**32 - 9)
        assert client.GetEncoders(FRONT) == (True, 123456, 2**32 - 9)
        assert client.SetM1VelocityPID(FRONT, 1.5, 0.5, 0.25, 44000)
        assert client.ReadM1VelocityPID(FRONT) == (True, 1.5, 0.5, 0.25, 44000)
        assert client.SetLogicVoltages(FRONT, 55, 65)
        assert client.ReadMinMaxLogicVoltages(FRONT) == (True, 55, 65)
        assert client.DutyAccelM1M2(FRONT, 10000, 20000, 655359, -20000)
        assert 0 <= device.duty[0] < 20000
        wait_for(lambda: client.ReadPWMs(FRONT) == (True, 20000, -20000))


def test_a_unit_that_is_not_there_does_not_answer_and_disturbs_nobody(tmp_path: Path) -> None:
    settings, plant = emulated()
    with client_of(tmp_path, RoboclawPairDevice(settings, plant), plant, retries=1) as client:
        with pytest.raises(PacketTimeoutError):
            client.ReadMainBatteryVoltage(NOBODY)
        assert client.ReadBuffers(REAR) == (True, 0x80, 0x80)


@pytest.mark.parametrize("width", [1, 2])
def test_a_status_of_older_firmware_is_no_status_to_a_client_that_knows_the_newest_only(
    tmp_path: Path, width: int
) -> None:
    settings, plant = emulated(status_bytes=width)
    with client_of(tmp_path, RoboclawDevice(settings, plant), plant, retries=1) as client:
        with pytest.raises(PacketTimeoutError):
            client.ReadError(FRONT)
        assert client.ReadBuffers(FRONT) == (True, 0x80, 0x80)
