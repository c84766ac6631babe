"""The processes that subscribe to messages, and how main() of each is run beside the fuzzer."""

import importlib
import signal
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmr.bus.streams import MOTOR_COMMAND
from fuzzing.duties import DutyChecks
from fuzzing.stepped_time import Clock, PlainClock
from robot_driver.emulator.devices import CONTROLLER_DEVICES, GYRO_DEVICES
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.robot_in_time import RobotInTime
from robot_driver.emulator.settings import load_settings
from robot_driver.simulated.host import SimulatedHost
from robot_driver.simulated.usb import OwnUsb, UsbAdapter

ROOT = Path(__file__).resolve().parents[2]
PARAMETERS = ROOT / "cmr/experiments/scenario/shipped/parameters/robot_0.yaml"
URL, OTHER_URL = "memq://fuzz", "memq://strangers"
ANYTHING = "anything"  # a value of Program.may_end: any message
SCENARIO = """\
duration: 60
parameters: {parameters}
robots:
  - {{id: 10, kind: virtual, behaviour: waypoints, waypoints: [[9.0, 0.0]]}}
  - {{id: 0, kind: emulated, start: [-1, 0], behaviour: "follow,leader=10"}}
"""


class Testbed:
    """The surroundings of a process: its folder, its clock, and the checks of its motors' duties, if any."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.clock: Clock = PlainClock()
        self.duties: DutyChecks | None = None


@dataclass(frozen=True)
class Program:
    """A process: its module with `main`, its arguments for a folder, and a function that replaces what it cannot use.

    `may_end` is part of the message with which it may end by itself; None: it may not. `url` is the bus from which
    it receives the fuzzed messages.
    """

    module: str
    arguments: Callable[[Path], Sequence[str]]
    prepare: Callable[[Testbed], None] = lambda _testbed: None
    may_end: str | None = None
    url: str = URL
    relays: bool = False  # it publishes messages of others unchanged
    needs_key: bool = False
    more: tuple[str, ...] = ()  # files in which it subscribes, besides that of its module
    instead: tuple[str, ...] = ()  # files in which it subscribes, if not in that of its module

    @property
    def files(self) -> tuple[str, ...]:
        """The files in which it subscribes."""
        own = self.module.replace(".", "/") + ".py"
        return self.instead or (f"tools/{own}" if own.startswith("cmr_tools/") else own, *self.more)


def _driver(testbed: Testbed) -> None:
    """Plug an emulated robot into a simulated computer, and let the driver run on it."""
    settings = load_settings(None)
    plant, host = Plant(settings), SimulatedHost(0)
    controller: Any = CONTROLLER_DEVICES["roboclaw"](settings, plant)
    devices = {"motor": controller, "gyro": GYRO_DEVICES["dsp3000"](settings, plant)}
    adapters: dict[str, UsbAdapter | OwnUsb] = {name: OwnUsb() for name in devices}
    host.plug_in(RobotInTime(plant, devices, host.arrive, adapters=adapters), adapters)
    module: Any = importlib.import_module("robot_driver.main")
    driver: Any = importlib.import_module("robot_driver.driver")
    module.Driver = lambda plan, stop_file: driver.Driver(plan, host, stop_file)
    testbed.clock = host
    testbed.duties = DutyChecks(MOTOR_COMMAND.channel(0), lambda: [duty / 32767.0 for duty in controller.duty])


def _without_high_priority(_testbed: Testbed) -> None:
    """Keep the emulator from raising its priority: the fuzzer runs in the same process."""
    module: Any = importlib.import_module("robot_driver.emulator.main")
    module.go_first = lambda: None


class FakeProcess:
    """A fake of subprocess.Popen: prints `ready`, and runs until it is stopped."""

    count = 1000

    def __init__(self, _command: object, stdout: Any = None, **_options: object) -> None:
        FakeProcess.count = 1000 + (FakeProcess.count - 999) % 8
        self.pid = FakeProcess.count
        self.returncode: int | None = None
        if stdout is not None:
            stdout.write(b"ready\n")

    def poll(self) -> int | None:
        """Return the exit code, None while it runs."""
        return self.returncode

    def wait(self, _timeout: float | None = None) -> int | None:
        """Return the exit code."""
        return self.returncode

    def terminate(self) -> None:
        """End the fake process."""
        self.returncode = -signal.SIGTERM

    kill = terminate


def _without_child_processes(_testbed: Testbed) -> None:
    """Start fakes in place of child processes."""
    module: Any = importlib.import_module("cmr.processes.children")
    module.subprocess = type(subprocess)("subprocess")
    module.subprocess.Popen, module.subprocess.DEVNULL, module.subprocess.STDOUT = FakeProcess, -3, -2
    module.subprocess.TimeoutExpired = subprocess.TimeoutExpired


def _run(testbed: Testbed) -> None:
    _without_child_processes(testbed)
    (testbed.folder / "team.yaml").write_text(SCENARIO.format(parameters=PARAMETERS))


def _camera(testbed: Testbed) -> None:
    """Replace the camera by one that always shows the same picture."""
    from fuzzing.still_camera import install_still_camera

    install_still_camera(testbed.folder)


def _ros2(_testbed: Testbed) -> None:
    """Replace ROS 2 by a fake without other nodes."""
    from fuzzing.fake_ros import install_fake_ros

    install_fake_ros()


def _own(folder: Path) -> str:
    return str(folder / "robot_0.yaml")


def _with_suspected_swap(_testbed: Testbed) -> None:
    """Let the tracker suspect that robot 0 was swapped with another, so that it subscribes to wheels and gyro."""
    module: Any = importlib.import_module("cmr.tracker.supervisor")
    module.Supervisor.in_doubt = lambda _self: {0}


def _tracker(folder: Path) -> str:
    """Write the profile of a tracker that does not answer; return its path."""
    path = folder / "tracker.yaml"
    path.write_text(
        "schema: 1\ntracker: {type: vrpn, server: 127.0.0.1, port: 9}\nrobots: {0: {body: a, wheel_radius: 0.05}}\n"
    )
    return str(path)


PROGRAMS = {
    "driver": Program(
        "robot_driver.main",
        lambda at: ["--port", "motor", "--gyro-port", "gyro", "--state", str(at / "state"), "--parameters", _own(at)],
        _driver,
    ),
    "emulate velocity": Program(
        "robot_driver.emulator.main", lambda _at: ["--command", "velocity", "--ideal"], _without_high_priority
    ),
    "emulate wheel_speed": Program(
        "robot_driver.emulator.main", lambda _at: ["--command", "wheel_speed", "--ideal"], _without_high_priority
    ),
    "sim": Program(
        "cmr.commands.sim",
        lambda at: [
            *("--parameters", str(at), "--virtual", "10=figure_eight,laps=0", "11=follow,leader=0", "12=waypoints,x=2"),
            *("13=commanded,y=2", "--range-sensor", "10"),
        ],
    ),
    "pilot": Program(
        "cmr.commands.pilot",
        lambda at: ["--parameters", _own(at), "--behaviour", "figure_eight,laps=0", "--geofence=-9,-9,9,-9,9,9,-9,9"],
        may_end="took over robot",
        instead=("cmr/commands/steering/steer.py",),
    ),
    "investigate": Program(
        "cmr.commands.investigating.command",
        lambda at: [
            "--parameters",
            _own(at),
            "--no-diagnosis",
            "--longest",
            "3600",
            "--out",
            str(at / "investigation"),
        ],
        may_end="took over robot",
        instead=("cmr/commands/steering/steer.py",),
    ),
    "calibrate": Program(
        "cmr.commands.calibrate",
        lambda at: ["--robot", "0", "--parameters", _own(at), "--out", str(at / "found.yaml")],
        may_end=ANYTHING,
    ),
    "diagnose": Program(
        "cmr.commands.diagnose",
        lambda at: ["--live", "--robot", "0", "--parameters", _own(at), "--out", str(at / "diagnosis")],
    ),
    "camera": Program(
        "cmr.commands.camera",
        lambda at: ["0", "--lens", str(at / "lens.yaml"), "--floor", str(at / "floor.yaml"), "--image-rate", "5"],
        _camera,
    ),
    "view": Program("cmr.commands.view", lambda _at: ["--port", "18400"], more=("cmr/view/data/live.py",)),
    "run": Program(
        "cmr.commands.run",
        lambda at: [str(at / "team.yaml"), "--out", str(at / "run")],
        _run,
        ANYTHING,
        more=("cmr/experiments/live/live_run.py",),
    ),
    "recorder": Program("cmr.experiments.live.recorder", lambda at: [str(at / "run.lcm")]),
    "agent": Program(
        "cmr.commands.agent", lambda at: ["--out", str(at / "agent")], _without_child_processes, needs_key=True
    ),
    "relay": Program(
        "cmr.commands.relay",
        lambda _at: ["--channel", "*", "--from", OTHER_URL],
        url=OTHER_URL,
        relays=True,
    ),
    "spy": Program("cmr_tools.spy.main", lambda _at: ["--json"]),
    "demo": Program("cmr.commands.demo", lambda at: ["--out", str(at / "demo")], _without_child_processes, ANYTHING),
    "demo lead": Program(
        "cmr.commands.demo",
        lambda at: ["--lead", "--script", "ahead 3600", "--out", str(at / "lead")],
        _without_child_processes,
        ANYTHING,
        more=("cmr/experiments/live/demonstrating.py",),
    ),
    "teleop": Program(
        "cmr.commands.by_hand.teleop",
        lambda at: ["--parameters", _own(at), "--script", "ahead 3600"],
        may_end="took over robot",
    ),
    "tracker": Program("cmr.tracker.command", lambda at: ["--profile", _tracker(at)], _with_suspected_swap),
    "ros2": Program(
        "robot_driver.ros2.command",
        lambda at: [
            *("--robot", "0=example", "--virtual", "10", "--show", "11", "--clock", "--parameters", str(at)),
            *("--state", str(at / "state")),
        ],
        _ros2,
    ),
    "estop": Program("cmr.commands.estop", lambda _at: ["status"], may_end=ANYTHING),
}
