"""The whole driver on a pseudo-terminal with an emulated Roboteq: it drives, measures, and above all stops."""

import dataclasses
import itertools
import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import make, now_utime
from cmr.bus.streams import MOTOR_COMMAND, MOTOR_FEEDBACK
from cmr.msg import motor_command_t, motor_feedback_t
from robot_driver.driver import Driver
from robot_driver.emulator.device import Transmission
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboteq_device import RoboteqDevice
from robot_driver.emulator.settings import load_settings
from robot_driver.settings import Settings
from robot_driver.terminals.pseudo_terminal import Ports
from tests.support.driver_bench import DriverProcess, PunctualEngine, open_gate_of
from tests.support.exchanges import Exchanges
from tests.support.gates import gate_of

pytestmark = pytest.mark.real_time

PATIENCE = 20.0  # s
NOT_ARMED, ESTOP = motor_feedback_t.STATUS_NOT_ARMED, motor_feedback_t.STATUS_ESTOP
BATTERY = motor_feedback_t.STATUS_BATTERY


class Robot:
    """An emulated robot with a Roboteq, `device`, at `port`; `settings` change those of the emulated one."""

    def __init__(self, folder: Path, device: type[RoboteqDevice] = RoboteqDevice, **settings: Any) -> None:
        emulated = load_settings().ideal()
        emulated = dataclasses.replace(emulated, roboteq=dataclasses.replace(emulated.roboteq, **settings))
        self.plant = Plant(emulated)
        self.device: Any = device(emulated, self.plant)
        self._ports = Ports(folder, ("motor",))
        self.port = str(folder / "motor")

    def __enter__(self) -> "Robot":
        self._ports.__enter__()
        self._engine = PunctualEngine(self.plant, {"motor": self.device}, self._ports.terminals)
        self._engine.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._engine.__exit__(*error)
        self._ports.__exit__(*error)
        self._engine.check()

    def at_rest(self) -> bool:
        return bool(self.device.duty == [0, 0])


class Client:
    """What a controller on the bus does: commands at a steady rate, and takes what is measured."""

    def __init__(self, driver: Driver) -> None:
        self.feedback: list[Any] = []
        self.left, self.right = 0.0, 0.0
        self._driver = driver
        open_gate_of(driver)

    def until(self, condition: Callable[[], object]) -> None:
        """Command until something is true."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, self._driver.problems()
            utime = now_utime()
            message = make(motor_command_t, utime=utime, robot_id=0, left=self.left, right=self.right)
            self._driver.turn()
            self._driver.handle(utime, MOTOR_COMMAND.channel(0), message)
            self.feedback += [message for stream, _, message in self._driver.outgoing() if stream is MOTOR_FEEDBACK]
            time.sleep(0.01)

    def command(self, left: float, right: float) -> None:
        self.left, self.right = left, right

    def more(self, count: int) -> list[Any]:
        """Command on until there are so many new measurements; return them."""
        seen = len(self.feedback)
        self.until(lambda: len(self.feedback) >= seen + count)
        return self.feedback[seen:]


def total(message: Any) -> tuple[int, int]:
    return message.ticks_left, message.ticks_right


def telemetry(message: Any) -> tuple[float, float, float, float]:
    return message.battery_voltage, message.current_left, message.current_right, message.temperature


def driving(robot: Robot) -> Driver:
    return Driver(Settings(port=robot.port, controller="roboteq"))


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with Robot(tmp_path / "ports") as robot:
        yield robot


def test_it_drives_as_commanded_and_writes_nothing_to_the_flash(robot: Robot) -> None:
    with driving(robot) as driver:
        client = Client(driver)
        client.command(0.5, -0.25)
        client.until(lambda: robot.device.duty == [500, -250])
        client.until(lambda: client.feedback and client.feedback[-1].applied_left == 0.5)
        assert client.feedback[-1].applied_right == -0.25
        assert driver.problems() == ""
    assert robot.device.actions[0] == robot.device.actions[-1] == "!M 0 0"
    assert robot.at_rest()
    assert robot.device.saves == 0


def test_counts_go_on_across_the_ends_of_32_bits_in_both_directions(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    robot.device.receive(b"!C 1 %d\r!C 2 %d\r" % (2**31 - 50, -(2**31) + 50), 0.0)
    with robot, driving(robot) as driver:
        client = Client(driver)
        client.command(0.4, -0.4)
        client.until(lambda: client.feedback and client.feedback[-1].ticks_left > 500)
        client.until(lambda: client.feedback[-1].ticks_right < -500)
        client.command(0.0, 0.0)
        client.until(lambda: total(client.feedback[-1]) == pytest.approx(robot.plant.encoder_counts(), abs=1))
    assert all(message.status & motor_feedback_t.STATUS_ENCODER_JUMP == 0 for message in client.feedback)


def test_battery_and_currents_and_temperature_are_told(robot: Robot) -> None:
    with driving(robot) as driver:
        client = Client(driver)
        client.until(lambda: client.feedback and not any(map(math.isnan, telemetry(client.feedback[-1]))))
    assert telemetry(client.feedback[-1]) == (12.4, 0.0, 0.0, 32.0)


class Honest(RoboteqDevice):
    """Tells zero for the command in force while its emergency stop is engaged."""

    def _act(self, *action: Any) -> str:
        done = super()._act(*action)
        self._wanted = list(self.duty)
        return done


@pytest.mark.parametrize("device", [RoboteqDevice, Honest])
def test_faults_of_the_controller_are_told_and_its_emergency_stop_holds_the_motors(
    tmp_path: Path, device: type[RoboteqDevice]
) -> None:
    with Robot(tmp_path, device) as robot, driving(robot) as driver:
        client = Client(driver)
        robot.device.faults = 0x04
        client.until(lambda: client.feedback and client.feedback[-1].status & BATTERY)
        robot.device.faults = 0x10
        client.command(0.3, 0.3)
        client.until(lambda: client.feedback[-1].status & ESTOP)
        assert robot.at_rest()
        assert all(message.applied_left == 0.0 for message in client.more(5))
        robot.device.faults = 0
        client.until(lambda: client.feedback[-1].status & (BATTERY | ESTOP) == 0)


class Hot(Honest):
    """Holds its motors as long as it is `too_hot`; `applied` are all duties of the left one."""

    too_hot = False

    def _apply(self, duty: list[float]) -> None:
        super()._apply([0, 0] if self.too_hot else duty)
        self.applied = [*getattr(self, "applied", []), self.duty[0]]


def test_motors_that_the_controller_held_by_itself_begin_at_zero_when_it_lets_them_go(tmp_path: Path) -> None:
    with Robot(tmp_path, Hot) as robot, driving(robot) as driver:
        client = Client(driver)
        client.command(0.8, 0.8)
        client.until(lambda: robot.device.duty == [800, 800])
        robot.device.too_hot = True
        client.until(lambda: client.more(3)[-1].applied_left == 0.0)
        let_go = len(robot.device.applied)
        robot.device.too_hot = False
        client.until(lambda: robot.device.duty == [800, 800])
    duties = robot.device.applied[let_go:]
    # 10 a second at most, and no turn counts for more than two of 10 ms.
    assert max(next_one - one for one, next_one in itertools.pairwise(duties[: duties.index(800) + 1])) <= 201


class Blinded(RoboteqDevice):
    """Tells no counts any more once its encoders are `torn_off`."""

    torn_off = False

    def _reading(self, name: str, *channel: int) -> str:
        if name == "C" and self.torn_off:
            raise KeyError
        return super()._reading(name, *channel)


def test_without_encoder_counts_it_never_drives(tmp_path: Path) -> None:
    robot = Robot(tmp_path, Blinded)
    robot.device.torn_off = True
    with robot, driving(robot) as driver:
        client = Client(driver)
        client.command(0.5, 0.5)
        client.until(lambda: "query C" in driver.problems())
    assert set(robot.device.actions) == {"!M 0 0"}


def test_encoders_that_fall_silent_while_driving_stop_the_motors(tmp_path: Path) -> None:
    with Robot(tmp_path, Blinded) as robot, driving(robot) as driver:
        client = Client(driver)
        client.command(0.5, 0.5)
        client.until(lambda: robot.device.duty == [500, 500])
        robot.device.torn_off = True
        client.until(lambda: "encoder counts" in driver.problems() or "query C" in driver.problems())
        client.until(robot.at_rest)
        done = len(robot.device.actions)
        client.until(lambda: len(robot.device.actions) > done + 5)
    assert set(robot.device.actions[done:]) == {"!M 0 0"}


def test_it_never_drives_when_the_watchdog_does_not_read_back(tmp_path: Path) -> None:
    with Robot(tmp_path, ignores_watchdog=True) as robot, driving(robot) as driver:
        client = Client(driver)
        client.command(0.5, 0.5)
        assert all(message.status & NOT_ARMED for message in client.more(20))
        assert "watchdog" in driver.problems()
        assert set(robot.device.actions) == {"!M 0 0"}


@pytest.mark.parametrize("echo", [True, False])
def test_a_restarted_device_is_armed_anew_before_it_drives_again(tmp_path: Path, echo: bool) -> None:
    with Robot(tmp_path, echo=echo, watchdog=0) as robot, driving(robot) as driver:
        client = Client(driver)
        client.command(0.5, 0.5)
        client.until(lambda: robot.device.duty == [500, 500])
        robot.device.switch_on()
        before = len(robot.device.actions)
        client.until(lambda: "!M 0 0" in robot.device.actions[before:])
        client.until(lambda: robot.device.duty == [500, 500])
        assert robot.device.watchdog == 500


def test_a_slow_line_is_waited_for(tmp_path: Path, exchanges: Exchanges) -> None:
    settings = Settings(port=str(tmp_path / "motor"), controller="roboteq", baud=9600, rate=10.0)
    with Robot(tmp_path, baud=9600), Driver(settings) as driver:
        Client(driver).more(5)
        exchanges.assert_only_stalls_failed()


class Noisy(RoboteqDevice):
    """Its answers are now and then lost, cut short, said twice, or preceded by another line.

    `truth` holds all counts that it ever said.
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.truth: set[tuple[int, ...]] = set()
        self.answers = 0

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        return [Transmission(one.time, self._tampered(one.data)) for one in super().receive(data, time)]

    def _tampered(self, answer: bytes) -> bytes:
        if answer.startswith(b"C="):
            self.truth.add(tuple(int(count) for count in answer[2:-1].split(b":")))
        self.answers += 1
        if self.answers < 50 or self.answers % 7:  # the connection may come first
            return answer
        return [b"", answer[:-2], answer + answer, b"&s=1:2\r" + answer, answer + b"FF=255\r"][self.answers // 7 % 5]


def test_lost_cut_doubled_and_foreign_answers_never_become_data(tmp_path: Path) -> None:
    with Robot(tmp_path, Noisy, echo=False) as robot, driving(robot) as driver:
        client = Client(driver)
        client.command(0.2, -0.2)
        client.more(100)
        assert "lost or damaged" in driver.remarks()
        assert driver.problems() == ""
    for message in client.feedback:
        assert total(message) in robot.device.truth
        assert message.status & (ESTOP | BATTERY) == 0


class Misheard(RoboteqDevice):
    """Loses the sign of one duty in seven; and takes `zeros_lost` zeros for others.

    `truth` holds what it counted and drove with whenever it was asked for the counts.
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.truth: set[tuple[int, ...]] = set()
        self.zeros_lost = 0
        self.duties = 0

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        if data == b"!M 0 0\r" and self.zeros_lost > 0:
            self.zeros_lost -= 1
            data = b"!M 80 0\r"
        elif data.startswith(b"!M"):
            self.duties += 1
            data = data if self.duties % 7 else data.replace(b"-", b"")
        elif data == b"?C\r":
            self.truth.add((*self.encoders(), *self.duty))
        return super().receive(data, time)


def test_3_a_duty_that_arrived_as_another_is_sent_again_and_never_told(tmp_path: Path) -> None:
    with Robot(tmp_path, Misheard, echo=False) as robot, driving(robot) as driver:
        client = Client(driver)
        client.command(0.2, -0.2)
        client.until(lambda: robot.device.duties > 100)
        assert client.feedback[-1].applied_right == -0.2
        assert driver.problems() == ""
    for message in client.feedback:
        duty = round(1000 * message.applied_left), round(1000 * message.applied_right)
        assert (*total(message), *duty) in robot.device.truth


def test_9_the_zero_at_exit_is_sent_until_the_device_tells_that_it_is_zero(tmp_path: Path) -> None:
    with Robot(tmp_path, Misheard) as robot:
        with driving(robot) as driver:
            client = Client(driver)
            client.command(0.5, 0.5)
            client.until(lambda: robot.device.duty == [500, 500])
            robot.device.zeros_lost = 3
        assert robot.device.zeros_lost == 0
        assert robot.at_rest()


def process_driving(robot: Robot) -> DriverProcess:
    """A cmr-driver that drives because it obeys commands."""
    process = DriverProcess(Path(robot.port).parent, "--controller", "roboteq")
    process.command_until(lambda: robot.device.duty == [500, 500])
    return process


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_driving_ends_with_a_zero_that_was_acknowledged(robot: Robot, number: int) -> None:
    process = process_driving(robot)
    assert process.end(number)[0] == 130
    assert robot.device.actions[-1] == "!M 0 0"
    assert robot.at_rest()
    assert robot.device.saves == 0


def test_the_devices_own_watchdog_stops_the_motors_when_the_host_dies(robot: Robot) -> None:
    process = process_driving(robot)
    os.kill(gate_of(process.process.pid), signal.SIGKILL)  # which would stop them at once
    process.end(signal.SIGKILL)
    deadline = time.monotonic() + PATIENCE
    while not robot.at_rest():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert robot.device.actions[-1] == "!M 500 500"
