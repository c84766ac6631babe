"""--list-devices tells what is plugged in where, and moves nothing."""

import termios
from pathlib import Path

import pytest

from robot_driver.emulator.device import Transmission
from robot_driver.emulator.devices import CONTROLLER_DEVICES, GYRO_DEVICES
from robot_driver.emulator.kvh_binary_device import KvhBinaryDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from robot_driver.gyros.kvh_binary import ENTER_CONFIGURATION, KvhBinary
from robot_driver.listing import Rates, describe
from robot_driver.main import main
from robot_driver.serial_port import PortLost, SerialPort
from robot_driver.terminals.pseudo_terminal import Ports, PseudoTerminal
from tests.robot_driver.emulator.test_emulator_kvh_binary import kvh_settings
from tests.support.driver_bench import PunctualEngine, wait_for

pytestmark = pytest.mark.waits


def described(folder: Path, kind: str) -> tuple[str, Plant]:
    """Return what is said of a port with such a device behind it, and the robot."""
    settings = load_settings().ideal()
    plant = Plant(settings)
    device = {**CONTROLLER_DEVICES, **GYRO_DEVICES}[kind](settings, plant)
    with Ports(folder, ("port",)) as ports, PunctualEngine(plant, {"port": device}, ports.terminals):
        return describe(str(folder / "port")), plant


@pytest.mark.parametrize("kind", sorted(CONTROLLER_DEVICES))
def test_a_controller_is_found_by_what_it_answers_and_nothing_moves(tmp_path: Path, kind: str) -> None:
    said, plant = described(tmp_path, kind)
    assert f"--controller {kind} (" in said
    assert plant.encoder_counts() == (0, 0)
    assert said.count("--controller") == 1  # of a pair, one unit alone would drive two wheels of four


@pytest.mark.parametrize("kind", sorted(GYRO_DEVICES))
def test_a_gyro_is_found_by_what_it_says(tmp_path: Path, kind: str) -> None:
    assert described(tmp_path, kind)[0].endswith(f"gyro: --gyro {kind}")


def listens_at(terminal: PseudoTerminal, speed: int) -> None:
    """Have the device understand nothing that is sent to it at another baud rate (a constant of termios)."""
    read = terminal.read

    def understood() -> bytes:
        data = read()
        return data if termios.tcgetattr(terminal.fileno())[4] == speed else bytes(len(data))

    terminal.read = understood  # type: ignore[method-assign]


def roboclaw_described(folder: Path, speed: int, rates: Rates) -> str:
    """Return what is said of a port with a RoboClaw that is set to such a baud rate (a constant of termios)."""
    settings = load_settings().ideal()
    plant = Plant(settings)
    device = CONTROLLER_DEVICES["roboclaw"](settings, plant)
    with Ports(folder, ("port",)) as ports:
        listens_at(ports.terminals["port"], speed)
        with PunctualEngine(plant, {"port": device}, ports.terminals):
            return describe(str(folder / "port"), rates)


def test_a_roboclaw_as_it_comes_from_the_factory_is_found(tmp_path: Path) -> None:
    assert "--controller roboclaw --baud 38400 (" in roboclaw_described(tmp_path, termios.B38400, Rates())


def test_a_controller_is_looked_for_at_the_rate_that_is_given_and_at_no_other(tmp_path: Path) -> None:
    rates = Rates(controller=57600)
    assert "--controller roboclaw --baud 57600 (" in roboclaw_described(tmp_path, termios.B57600, rates)
    assert roboclaw_described(tmp_path, termios.B38400, rates).endswith("nothing that cmr-driver knows answers")


def test_the_command_looks_at_the_rates_it_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Rates] = []

    def noted(_path: str, rates: Rates) -> str:
        asked.append(rates)
        return ""

    monkeypatch.setattr("robot_driver.main.describe", noted)
    main(["--list-devices", "--port", "/dev/null", "--baud", "38400"])
    main(["--list-devices", "--port", "/dev/null", "--gyro-port", "/dev/null", "--gyro-baud", "460800"])
    assert asked == [Rates(controller=38400), Rates(gyro=460800), Rates(gyro=460800)]


def test_a_gyro_that_is_asked_how_it_is_set_and_does_not_tell_in_time_goes_on_talking(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robot_driver.listing.CONVERSATION", 0.0)
    monkeypatch.setattr("robot_driver.listing.GYROS", {"kvh-binary": KvhBinary})
    settings = kvh_settings()
    plant = Plant(settings)
    device = KvhBinaryDevice(settings, plant)
    device._powered_up = True  # long ago: it does not tell of its self-test
    told: list[bytes] = []
    receive = device.receive

    def noted(data: bytes, time: float) -> list[Transmission]:
        told.append(data)
        return receive(data, time)

    monkeypatch.setattr(device, "receive", noted)
    with Ports(tmp_path, ("port",)) as ports, PunctualEngine(plant, {"port": device}, ports.terminals):
        assert "nothing that cmr-driver knows answers" in describe(str(tmp_path / "port"))
        wait_for(lambda: ENTER_CONFIGURATION in b"".join(told) and not device._configuring)


def test_a_port_is_not_asked_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robot_driver.listing.LONGEST_ASKING", 0.0)
    with Ports(tmp_path, ("port",)) as ports:
        assert "nothing that cmr-driver knows answers" in describe(str(tmp_path / "port"))
        assert ports.terminals["port"].read() == b""


def test_a_port_in_use_is_left_alone(tmp_path: Path) -> None:
    with Ports(tmp_path, ("port",)) as ports:
        port = SerialPort(str(tmp_path / "port"), 115200)
        port.open()
        with pytest.raises(PortLost, match="Another program is using"):
            describe(str(tmp_path / "port"))
        assert ports.terminals["port"].read() == b""
        port.close()


def test_the_command_lists_the_ports_it_is_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Ports(tmp_path, ("port",)) as ports:
        assert main(["--list-devices", "--port", str(tmp_path / "port")]) == 0
        device = ports.paths["port"].resolve()
    told = capsys.readouterr().out
    assert told == f"{tmp_path}/port (now {device})\n    nothing that cmr-driver knows answers\n"


def test_a_port_that_was_named_but_is_not_there_is_told_and_the_others_are_listed_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Ports(tmp_path, ("port",)):
        assert main(["--list-devices", "--port", "/dev/none", "--gyro-port", str(tmp_path / "port")]) == 1
    told = capsys.readouterr().out
    assert told.startswith("/dev/none\n    not asked: There is no serial port /dev/none. ")
    assert "nothing that cmr-driver knows answers" in told


def test_a_port_that_was_found_but_is_in_use_is_no_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("robot_driver.main.available_ports", lambda: ["/dev/none"])
    assert main(["--list-devices"]) == 0
    assert "not asked" in capsys.readouterr().out
