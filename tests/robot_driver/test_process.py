"""The driver as a whole: it says what is wrong in one sentence, takes parameters over, and ends at once."""

import errno
import os
import subprocess
import sys
import threading
import time
import tty
from dataclasses import fields, replace
from pathlib import Path

import pytest
import yaml

from cmr.bus.messages import make, now_utime
from cmr.bus.streams import ESTOP, MOTOR_COMMAND
from cmr.cli.options import arguments_of, made_of
from cmr.documents.document import DocumentError, read
from cmr.documents.structure import structured
from cmr.msg import estop_t, motor_command_t
from robot_driver import gyro_device
from robot_driver.clock import seconds_since_boot
from robot_driver.controllers import CONTROLLERS
from robot_driver.driver import Driver
from robot_driver.emulator.boards import roboclaw
from robot_driver.encoders import FASTEST_WHEEL
from robot_driver.main import command_parser, main
from robot_driver.serial_port import why_not_open
from robot_driver.settings import Connection, Settings
from tests.support.driver_bench import bench, open_gate_of, wait_for

pytestmark = pytest.mark.real_time

PARAMETER_FILE = """schema: 1
robot_id: {robot_id}
written: 2026-01-31T12:00:00Z
parameters:
  wheel_radius: {{value: 0.04, unit: m}}
  k1: {{value: {k1}, unit: s/rad}}
"""


def test_a_silent_device_is_reported_and_does_not_hold_up_the_end(silent_port: str) -> None:
    with Driver(Settings(port=silent_port)) as driver:
        assert driver.problems()
        deadline = time.monotonic() + 10.0
        while "does not answer" not in driver.problems():
            assert time.monotonic() < deadline
            time.sleep(0.01)
        began = time.monotonic()
    assert time.monotonic() - began < 1.0


@pytest.mark.parametrize("controller", sorted(CONTROLLERS))
def test_9_the_attempts_to_stop_a_silent_device_end_in_time(silent_port: str, controller: str) -> None:
    driver = Driver(Settings(port=silent_port, controller=controller))
    with driver:
        wait_for(lambda: "does not answer" in driver.problems())
    workers = [thread._thread for thread in driver._threads]
    assert not any(isinstance(worker, threading.Thread) and worker.is_alive() for worker in workers)
    assert all(isinstance(worker, threading.Thread) for worker in workers)


def test_parameters_in_use_say_how_fast_wheels_can_turn(silent_port: str, tmp_path: Path) -> None:
    path = tmp_path / "robot_0.yaml"
    path.write_text(PARAMETER_FILE.format(robot_id=0, k1=0.05))
    driver = Driver(Settings(port=silent_port, parameters=path))
    assert driver._motors.fastest_wheel == pytest.approx(40.0)
    assert driver.follower.sha256
    assert Driver(Settings(port=silent_port))._motors.fastest_wheel == FASTEST_WHEEL


def test_a_nominal_parameter_file_with_the_wheel_radius_alone_is_fine(silent_port: str, tmp_path: Path) -> None:
    path = tmp_path / "robot_0.yaml"
    path.write_text(
        "".join(line for line in PARAMETER_FILE.format(robot_id=0, k1=1).splitlines(True) if "k1" not in line)
    )
    driver = Driver(Settings(port=silent_port, parameters=path))
    assert driver._motors.fastest_wheel == FASTEST_WHEEL
    assert driver.remarks() == ""


def test_a_foreign_parameter_file_changes_nothing_and_is_reported(silent_port: str, tmp_path: Path) -> None:
    path = tmp_path / "robot_1.yaml"
    path.write_text(PARAMETER_FILE.format(robot_id=1, k1=0.05))
    driver = Driver(Settings(port=silent_port, parameters=path))
    assert driver._motors.fastest_wheel == FASTEST_WHEEL
    assert "robot 1" in driver.remarks()


def test_commands_that_were_not_taken_are_counted_by_reason(silent_port: str) -> None:
    driver = Driver(Settings(port=silent_port, robot=3))
    open_gate_of(driver)
    now = now_utime()
    for utime, left in ((now, 0.1), (now, float("nan")), (now, 1.5), (now, 0.1), (now - 3_600_000_000, 0.1)):
        message = make(motor_command_t, utime=utime, robot_id=3, left=left, right=0.0)
        driver.handle(utime, MOTOR_COMMAND.channel(3), message)
    assert driver.remarks() == "Commands not taken: not_finite 1, old 2, out_of_range 1."


def test_gyro_readings_without_a_rate_are_counted_by_reason_and_explained(
    silent_port: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gyro_device, "INVALID_LIMIT", 0.2)
    master, slave = os.openpty()
    tty.setraw(slave)

    def said(valid: int) -> str:
        os.write(master, b"       1.000000   %d\r\n" % valid)
        time.sleep(0.01)
        return driver.problems()

    with Driver(Settings(port=silent_port, gyro_port=os.ttyname(slave))) as driver:
        os.write(master, b"\n       1.0000x0   1\r\n")
        wait_for(lambda: "readings are not valid" in said(0))
        assert "Yaw rates missing: lost 1, not valid " in driver.remarks()
        wait_for(lambda: "The gyro" not in said(1))
    os.close(master)
    os.close(slave)


def test_what_the_controller_says_is_wrong_is_told_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with bench(tmp_path) as run:
        assert run.thread.problem == ""
        monkeypatch.setattr(roboclaw, "HEALTHY", 0x00010000)
        wait_for(lambda: "controller reports: a motor takes too much current" in run.thread.problem)
        monkeypatch.setattr(roboclaw, "HEALTHY", 0x00000001)
        wait_for(lambda: "controller reports: its emergency stop is engaged." in run.thread.problem)
        monkeypatch.setattr(roboclaw, "HEALTHY", 0)
        wait_for(lambda: run.thread.problem == "")


def test_estop_on_the_bus_reaches_the_motors(silent_port: str) -> None:
    driver = Driver(Settings(port=silent_port))
    open_gate_of(driver)
    now = now_utime()
    driver.handle(now, MOTOR_COMMAND.channel(0), make(motor_command_t, utime=now, robot_id=0, left=0.5, right=0.5))
    assert driver._gate.drive(seconds_since_boot()).left == 0.5
    for engaged in (True, False):
        stop = make(estop_t, utime=now_utime(), engaged=engaged, source="test", reason="test")
        driver.handle(stop.utime, ESTOP.channel(), stop)
        assert driver._gate.drive(seconds_since_boot()).left == 0.0
    assert driver.remarks() == "Waiting for zero to be commanded; nothing else moves the motors before."
    open_gate_of(driver)
    assert driver.remarks() == ""


def test_a_port_that_cannot_be_opened_is_explained() -> None:
    assert "dialout" in why_not_open("/dev/ttyUSB0", PermissionError(errno.EACCES, "denied"))
    assert "Another program" in why_not_open("/dev/ttyUSB0", OSError(errno.EBUSY, "busy"))
    assert "not a serial port" in why_not_open("/dev/null", OSError(errno.ENOTTY, "ioctl"))


@pytest.mark.parametrize(
    "wrong",
    [
        ["--rate", "0"],
        ["--rate", "4.9"],
        ["--robot", "-1"],
        ["--baud", "x"],
        ["--deceleration", "1"],
        ["--ticks-per-turn", "0"],
        ["--gyro-baud", "9600"],
    ],
)
def test_wrong_usage_exits_with_2(wrong: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--port", "/dev/null", *wrong])
    assert end.value.code == 2
    assert wrong[0].removeprefix("--")[:4] in capsys.readouterr().err


def test_the_driver_needs_no_more_than_a_small_computer_has() -> None:
    """Beside Python: pyserial, lcm, PyYAML, and NumPy, which `cmr.bus` imports for WORLD_STATE."""
    code = "import sys, robot_driver.main; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    allowed = {"cmr", "robot_driver", "serial", "lcm", "yaml", "numpy", "cython_runtime"}
    installed = set(ended.stdout.split()) - set(sys.stdlib_module_names)
    assert {name for name in installed if not name.startswith(("_", "sitecustomize"))} <= allowed


def test_every_option_of_the_driver_may_be_in_a_scenario_and_goes_to_its_command_line() -> None:
    wanted = Connection("/dev/a", "/dev/b", "roboteq", "kvh-binary", 9600, 57600, 50.0, 5.0, 6.0, 11.0, 10.0, 480)
    wanted = replace(wanted, swap=True, invert_left=True, invert_right=True, invert_gyro=True)
    wanted = replace(wanted, swap_encoders=True, invert_left_encoder=True, invert_right_encoder=True)
    given = {field.name: getattr(wanted, field.name) for field in fields(Connection)}
    assert all(given[field.name] != field.default for field in fields(Connection))
    assert structured(read(yaml.safe_dump(given), "robot.yaml", DocumentError), Connection) == wanted
    options = command_parser().parse_args(arguments_of(wanted))
    assert made_of(Connection, options) == wanted
    with pytest.raises(DocumentError, match=r"line 2: driver: --gyro-baud is for a gyro on a port of its own"):
        structured(dict(read("\ndriver: {port: a, gyro_baud: 9}", "a", DocumentError).entries())["driver"], Connection)
