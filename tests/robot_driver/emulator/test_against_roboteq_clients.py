"""Clients of Roboteqs that nobody here wrote drive the emulated robot and read it.

`PyRoboteq` puts numbers in brackets and a plus sign at the end of each line, and takes what comes at once for the whole
answer, as it does over USB. `roboteq` only writes; what comes back it leaves to whoever asks later.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from PyRoboteq import RoboteqHandler
from PyRoboteq import roboteq_commands as commands
from roboteq import RoboteqDevice as Client
from roboteq.roboteq_constants import _G, _MMOD, _MXRPM

from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboteq_device import RoboteqDevice
from tests.robot_driver.emulator.served import emulated, served
from tests.support.driver_bench import wait_for

pytestmark = pytest.mark.waits


@contextmanager
def serving(folder: Path, **roboteq: Any) -> Iterator[tuple[str, RoboteqDevice, Plant]]:
    settings, plant = emulated("roboteq", watchdog=0, **roboteq)
    device = RoboteqDevice(settings, plant)
    with served(folder, device, plant) as port:
        yield port, device, plant


@contextmanager
def handler(folder: Path) -> Iterator[tuple[Any, RoboteqDevice, Plant]]:
    """Serve PyRoboteq over USB."""
    with serving(folder, baud=0) as (port, device, plant):
        client = RoboteqHandler()
        assert client.connect(port)
        yield client, device, plant
        client.ser.close()


def read(client: Any, query: str, channel: int | str = "") -> str:
    """Read until the answer comes: it takes half of one, and the late answer to what was written before, for it."""
    said: list[str] = []

    def answered() -> bool:
        client.ser.reset_input_buffer()
        said.append(client.read_value(query, channel))
        return said[-1].startswith(f"{query[1:]}=")

    wait_for(answered)
    return said[-1]


def number(client: Any, query: str, channel: int) -> int:
    return int(read(client, query, channel).split("=")[1])


def test_the_wheels_turn_as_pyroboteq_commands(tmp_path: Path) -> None:
    with handler(tmp_path) as (client, device, _):
        client.dual_motor_control(300, -200)
        wait_for(lambda: device.duty == [300, -200])
        wait_for(lambda: number(client, commands.READ_ABSCNTR, 1) > 500)
        assert number(client, commands.READ_ABSCNTR, 2) < 0
        assert read(client, commands.READ_MOTCMD) == "M=300:-200"
        client.send_command(commands.GO, 2, 1000)
        wait_for(lambda: device.duty == [300, 1000])
        wait_for(lambda: number(client, "?S", 2) == pytest.approx(177, abs=3))
        client.send_raw_command("!M 0 0")
        wait_for(lambda: number(client, "?S", 1) == number(client, "?S", 2) == 0)
        assert device.not_understood == {}


def test_pyroboteq_keeps_a_speed_in_closed_loop(tmp_path: Path) -> None:
    with handler(tmp_path) as (client, _, plant):
        client.send_command("^MMOD", 1, 1)
        client.send_command("!AC", 1, 5000)
        client.send_command(commands.SET_SPEED, 1, 100)
        wait_for(lambda: number(client, "?S", 1) == pytest.approx(100, abs=1))
        assert plant.left.velocity == pytest.approx(100 * 0.10472, rel=0.05)
        assert plant.right.velocity == 0.0


def test_pyroboteq_stops_for_an_emergency_and_releases_it(tmp_path: Path) -> None:
    with handler(tmp_path) as (client, device, _):
        client.send_command(commands.EM_STOP)
        wait_for(lambda: device.faults == 0x10)
        client.dual_motor_control(300, 300)
        assert read(client, commands.READ_FLTFLAG) == "FF=16"
        assert device.duty == [0, 0]
        client.send_command(commands.REL_EM_STOP)
        client.dual_motor_control(300, 300)
        wait_for(lambda: device.duty == [300, 300])


def test_everything_that_pyroboteq_reads_of_two_channels_is_answered(tmp_path: Path) -> None:
    with handler(tmp_path) as (client, device, _):
        assert read(client, commands.READ_FID) == "FID=Roboteq v1.6 SDC2160 05/01/2016"
        assert read(client, commands.READ_VOLTS) == "V=135:124:4730"
        assert read(client, commands.READ_VOLTS, 2) == "V=124"
        assert read(client, commands.READ_TEMP) == "T=32:32:32"
        for query in (commands.READ_MOTOR_AMPS, commands.READ_BATTERY_AMPS, commands.READ_ABSCNTR):
            assert read(client, query) == f"{query[1:]}=0:0"
        assert device.not_understood == {}
        client.ser.reset_input_buffer()
        client.read_value(commands.READ_BL_MOTOR_RPM)  # motors with brushes have none
        wait_for(lambda: device.not_understood == {"?BS": 1})


def test_the_wheels_turn_as_roboteq_commands(tmp_path: Path) -> None:
    with serving(tmp_path, echo=False) as (port, device, plant):
        client = Client()
        assert client.connect(port)
        client.command_motor(_G, 1, 500)
        client.command_motor(_G, 2, -250)
        wait_for(lambda: device.duty == [500, -250])
        client.set_config(_MMOD, 2, 1)
        client.set_config(_MXRPM, 2, 100)
        client.command_motor("!S", 2, 50)
        wait_for(lambda: plant.right.velocity == pytest.approx(50 * 0.10472, rel=0.02))
        client.getdata()
        client.send_command("?S 2")
        said: list[str] = []
        wait_for(lambda: said.append(client.getdata()) or "r" in said[-1])  # type: ignore[func-returns-value]
        assert re.fullmatch(r"S=(49|50|51)\\r", "".join(re.findall(r"b'([^']*)'", "".join(said))))
        assert device.not_understood == {}
        client.ser.close()


def test_what_roboteq_writes_for_a_setting_of_the_whole_device_is_refused(tmp_path: Path) -> None:
    with serving(tmp_path) as (port, device, _):
        client = Client()
        assert client.connect(port)
        client.set_config("^RWD", 500)  # it writes "^RWD 500 None"
        wait_for(lambda: device.not_understood == {"^RWD": 1})
        client.ser.close()
