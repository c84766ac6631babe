"""--list-devices tells what is plugged in where, and moves nothing."""

from pathlib import Path

import pytest

from robot_driver.emulator.devices import CONTROLLER_DEVICES, GYRO_DEVICES
from robot_driver.emulator.engine import Engine
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.pseudo_terminal import Ports
from robot_driver.emulator.settings import load_settings
from robot_driver.listing import describe
from robot_driver.main import main
from robot_driver.serial_port import SerialPort


def described(folder: Path, kind: str) -> tuple[str, Plant]:
    """Return what is said of a port with such a device behind it, and the robot."""
    settings = load_settings().ideal()
    plant = Plant(settings)
    device = {**CONTROLLER_DEVICES, **GYRO_DEVICES}[kind](settings, plant)
    with Ports(folder, ("port",)) as ports, Engine(plant, {"port": device}, ports.terminals):
        return describe(str(folder / "port")), plant


@pytest.mark.parametrize("kind", sorted(CONTROLLER_DEVICES))
def test_a_controller_is_found_by_what_it_answers_and_nothing_moves(tmp_path: Path, kind: str) -> None:
    said, plant = described(tmp_path, kind)
    assert f"--controller {kind} (" in said
    assert plant.encoder_counts() == (0, 0)
    others = {"roboclaw", *CONTROLLER_DEVICES} - {kind, *(["roboclaw"] if kind == "roboclaw-pair" else [])}
    assert not any(f"--controller {other} (" in said for other in others)


@pytest.mark.parametrize("kind", sorted(GYRO_DEVICES))
def test_a_gyro_is_found_by_what_it_says(tmp_path: Path, kind: str) -> None:
    assert described(tmp_path, kind)[0].endswith(f"gyro: --gyro {kind}")


def test_a_port_in_use_is_left_alone(tmp_path: Path) -> None:
    with Ports(tmp_path, ("port",)) as ports:
        port = SerialPort(str(tmp_path / "port"), 115200)
        port.open()
        assert "Another program is using" in describe(str(tmp_path / "port"))
        assert ports.terminals["port"].read() == b""
        port.close()


def test_the_command_lists_the_ports_it_is_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Ports(tmp_path, ("port",)) as ports:
        assert main(["--list-devices", "--port", str(tmp_path / "port")]) == 0
        device = ports.paths["port"].resolve()
    told = capsys.readouterr().out
    assert told == f"{tmp_path}/port (now {device})\n    nothing that cmr-driver knows answers\n"
