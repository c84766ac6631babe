"""cmr-demo: the main workflow without hardware. An emulated robot is driven, calibrated and driven again."""

import argparse
import re
import socket
import time
import webbrowser
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import lcm
import numpy as np

from cmr.bus.message import Message
from cmr.bus.messages import make, now_utime
from cmr.bus.preflight import check as check_bus
from cmr.bus.process import Process
from cmr.bus.streams import CALIBRATION_STATUS, PROCESS_STATUS, WAYPOINTS, WORLD_STATE
from cmr.cli.command_line import check_writable, parser
from cmr.cli.configuration import DEFAULT_URL, results
from cmr.cli.errors import CommandError
from cmr.commands.by_hand.demo import add_lead, lead
from cmr.commands.first_use import PARTS, compile_first
from cmr.commands.investigating.demo import add_investigate, demonstrate
from cmr.experiments.live.demonstrating import wait_for
from cmr.experiments.live.jobs import STATE
from cmr.files import gone_before_and_after
from cmr.geometry.figures import LENGTH, figure_eight
from cmr.model.parameters import DEFINITIONS
from cmr.msg import calibration_status_t, process_status_t, waypoints_t, world_state_t
from cmr.parameters.file import ParameterFile, Value, load
from cmr.processes.children import Children, our_command
from cmr.world.behaviours.leading import SPEEDS, laps_within, read_speeds, seconds_of
from cmr.world.comparison import Drive, draw_before_and_after, drives_of
from cmr.world.view import WorldView
from robot_driver.emulator.settings import Settings, SettingsError, load_settings

ROBOT = 0
LEADER = 10
FOLLOWER = 11  # virtual, following the real robot
USUAL_FOLDER = "demo-run"
GAP = 0.5  # m between one robot and the next
# m, of the figure-eight: leader, robot and follower form a line of 1.7 m at 0.5 m/s, and must not meet at its crossing
SIZE = 1.15
FASTEST = 0.5  # m/s; followers drive 0.6 m/s at most, and must catch up
DRIVE = 60.0  # s, rounded to whole figure-eights
# Nominal parameters, each wrong by a quarter to a third.
NOMINAL = {"wheel_radius": 0.04, "k2_over_k3": 80.0, "k1": 0.065, "base_width": 0.20}
START_UP = 240.0  # s until all processes are running, on a slow machine that compiles the robot model first
FIT = 600.0  # s, on a slow and busy machine: two cores with a load of 18 took longer than 120 s
REST_BEFORE = 2.5  # s
REST = 1_500_000  # us for which robot and leader must stand still before a drive counts as over


class Interrupted(Exception):  # noqa: N818 - the user's request, not an error
    """Ctrl-C or SIGTERM."""


def main(arguments: list[str]) -> int:
    """Run cmr-demo."""
    options = command_parser().parse_args(arguments)
    try:
        settings = load_settings(options.settings)
    except SettingsError as error:
        raise CommandError(str(error)) from error
    settings = settings.ideal() if options.ideal else settings
    url = options.lcm_url or _private_url()
    check_bus(url)  # report errors before anything takes time
    folder = free_folder(options.out)
    check_writable(folder)
    compile_first(PARTS)
    if options.lead:
        return lead(options, folder, url)
    if options.investigate:
        return demonstrate(options, folder, url)
    robot_ends = gone_before_and_after(folder / STATE)
    with Process("cmr-demo", url, lives_now=True) as process, robot_ends, Children(folder) as children:
        _prepare(folder)
        demo = _Demo(process, children, read_speeds(options.speed))
        try:
            if options.view:
                demo.open_page([our_command("cmr-view"), "--lcm-url", process.bus.url])
            demo.run(_commands(folder, process.bus.url, options))
        except Interrupted:
            print("Stopping.", flush=True)
            return process.exit_code
    return _report(folder, settings)


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-demo."""
    options = parser(
        "cmr-demo",
        "Drive an emulated robot through figure-eights behind a virtual leader, calibrate it, and drive again: all "
        "processes that a real robot needs, on an LCM bus of their own, with a pseudo-terminal for the serial line. "
        "Each drive takes a minute, half of it slow and half of it fast: at one speed some parameters cannot be "
        "distinguished from what the model leaves out. Takes about two and a half minutes.",
        "cmr-demo --out demo-run\n  cmr-demo --speed 0.3     # one speed, as in the paper\n"
        "  cmr-demo --lead          # drive yourself\n"
        "  cmr-demo --investigate   # watch a robot find out what is hidden in it",
        bus="LCM bus; otherwise one of its own, on a free port, that does not leave this host",
    )
    options.add_argument(
        "--out",
        type=Path,
        default=None,
        metavar="DIR",
        help=f"folder for the results; otherwise {results() / USUAL_FOLDER}, and an earlier run there is renamed",
    )
    options.add_argument("--settings", type=Path, default=None, metavar="FILE", help="as for cmr-emulate")
    options.add_argument(
        "--speed",
        type=_speeds,
        default=SPEEDS,
        metavar="M/S[/M/S...]",
        help="of the drive in m/s, one or several; each for the same time, together a minute",
    )
    add_lead(options)
    add_investigate(options)
    options.add_argument("--ideal", action="store_true", help="emulate a robot that is exactly as the model says")
    options.add_argument(
        "--view",
        action="store_true",
        help="open the page of cmr-view: the twin leaves its robot, and stays with it after the calibration",
    )
    return options


def _speeds(text: str) -> str:
    try:
        fastest = max(read_speeds(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    if fastest > FASTEST:
        raise argparse.ArgumentTypeError(f"{fastest:g} m/s are too fast for a robot that follows: {FASTEST:g} at most")
    return text


def _private_url() -> str:
    """Return a private bus: a free port, limited to this host."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return DEFAULT_URL.replace(":7667", f":{probe.getsockname()[1]}")


def free_folder(wanted: Path | None) -> Path:
    """Return an unused folder for the results: an earlier run in the usual folder is renamed.

    Raises CommandError if the folder named by the user contains a run.
    """
    folder = wanted or results() / USUAL_FOLDER
    log = folder / "run.lcm"
    if not log.exists():
        return folder
    if wanted:
        raise CommandError(f"{folder} holds a run already. Choose another folder with --out.")
    earlier = folder.with_name(f"{folder.name}-{time.strftime('%Y%m%d-%H%M%S', time.localtime(log.stat().st_mtime))}")
    folder.rename(earlier)
    print(f"The earlier run is now in {earlier}.", flush=True)
    return folder


def _prepare(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        nominal = ParameterFile(ROBOT, {name: Value(value) for name, value in NOMINAL.items()})
        nominal.save(folder / f"robot_{ROBOT}.yaml")
    except OSError as error:
        raise CommandError(f"{folder}: cannot be written: {error.strerror}. Choose another with --out.") from error


def _commands(folder: Path, url: str, options: argparse.Namespace) -> dict[str, list[str]]:
    """Return the command of each process, in the order in which they start."""
    ports, parameters = folder / "ports", str(folder / f"robot_{ROBOT}.yaml")
    bus = ["--lcm-url", url]
    emulate = [our_command("cmr-emulate"), "--robot", str(ROBOT), "--ports", str(ports), *bus]
    if options.settings:
        emulate += ["--settings", str(options.settings)]
    if options.ideal:
        emulate += ["--ideal"]
    return {
        "logger": [str(Path(lcm.LCM_BIN_DIR) / "lcm-logger"), f"--lcm-url={url}", "-q", str(folder / "run.lcm")],
        "emulate": emulate,
        "driver": [
            *(our_command("cmr-driver"), "--robot", str(ROBOT), "--port", str(ports / "motor")),
            *("--gyro-port", str(ports / "gyro"), "--parameters", parameters),
            *("--state", str(folder / STATE), *bus),
        ],
        "sim": [
            *(our_command("cmr-sim"), "--parameters", str(folder), "--parameters-of", str(ROBOT)),
            *("--virtual", f"{LEADER}=figure_eight,laps=0,speed={options.speed},x={GAP}"),
            *("--virtual", f"{FOLLOWER}=follow,leader={ROBOT},gap={GAP},x={-GAP}", *bus),
        ],
        "pilot": [
            *(our_command("cmr-pilot"), "--robot", str(ROBOT), "--parameters", parameters),
            *("--behaviour", f"follow,leader={LEADER},gap={GAP}", *bus),
        ],
        "calibrate": [our_command("cmr-calibrate"), "--robot", str(ROBOT), "--out", parameters, *bus],
    }


class _Demo:
    """A run of the demo: its steps, and its output."""

    def __init__(self, process: Process, children: Children, speeds: Sequence[float]) -> None:
        self._process = process
        self._speeds = speeds
        self._children = children
        self._world = WorldView()
        self._states: dict[str, int] = {}
        self._parameters_in_use = ""
        self._parameters_before = ""
        self._calibration: calibration_status_t | None = None
        self._last_motion = 0
        process.subscribe(WORLD_STATE)
        process.subscribe(PROCESS_STATUS, every=True)
        process.subscribe(CALIBRATION_STATUS, ROBOT)

    def open_page(self, command: list[str]) -> None:
        """Start cmr-view and show its page in the browser."""
        self._children.start("view", command)
        self._wait(lambda: bool(self._page()), START_UP, "the page")
        print(f"Look at {self._page()}: the robot is yellow, its twin green.", flush=True)
        webbrowser.open(self._page())

    def _page(self) -> str:
        """Return the address that cmr-view prints; empty before it does."""
        found = re.search(r"http://\S+", self._children.said("view"))
        return found[0] if found else ""

    def run(self, commands: dict[str, list[str]]) -> None:
        """Start everything, drive, calibrate, drive again."""
        began = time.monotonic()
        for name, command in commands.items():
            self._children.start(name, command)
            if name == "emulate":
                self._wait(lambda: "ready" in self._children.said("emulate"), START_UP, "the emulated robot")
        self._wait(self._ready, START_UP, "all processes")
        print(f"[{time.monotonic() - began:5.1f} s] {', '.join(commands)} are running", flush=True)
        self._parameters_before = self._parameters_in_use
        # The calibration uses the rest before the drive; let the calibrator receive as much of it as the log contains.
        rested_at = time.monotonic() + REST_BEFORE
        self._wait(lambda: time.monotonic() >= rested_at, 2.0 * REST_BEFORE, "the robot to have rested")
        self._drive("first drive, with the nominal parameters")
        self._wait(self._calibrated, FIT, "the calibration")
        self._wait(self._new_parameters_in_use, 5.0, "cmr-sim to use the new parameters")
        assert self._calibration is not None, "the calibration was waited for"
        print(f"calibrated: {self._calibration.message} Path error of the fit: ", end="")
        print(f"{self._calibration.path_rmse_before:.3f} m before, {self._calibration.path_rmse_after:.3f} m after")
        self._drive("second drive, with the parameters found")
        print(f"[{time.monotonic() - began:5.1f} s] done", flush=True)

    def _drive(self, title: str) -> None:
        """Let the leader drive figure-eights from where it is, and wait until all robots rest again."""
        leader = self._world.robot(LEADER)
        assert leader is not None, "the leader is there"
        state = leader.state
        laps = laps_within(DRIVE, SIZE, self._speeds)
        x, y = figure_eight(state.x, state.y, state.theta, SIZE, laps)
        expected = seconds_of(laps * LENGTH * SIZE, self._speeds) + 4.0
        self._process.publish(WAYPOINTS, make(waypoints_t, utime=now_utime(), robot_id=LEADER, x=x, y=y), LEADER)
        self._last_motion = now_utime()
        self._wait(self._resting, 4.0 * expected, title, expected)
        print(f"{title}: done", flush=True)

    def _wait(self, condition: Callable[[], bool], seconds: float, what: str, expected: float | None = None) -> None:
        """Handle messages until a condition holds; see `wait_for`. Raises Interrupted on a signal."""
        if not wait_for(condition, seconds, what, self._process, self._children, self._hear, expected):
            raise Interrupted

    def _hear(self, utime: int, channel: str, message: Message) -> None:
        if isinstance(message, world_state_t):
            self._world.handle(utime, channel, message)
            self._note_motion()
        elif isinstance(message, calibration_status_t):
            self._calibration = message
        elif isinstance(message, process_status_t):
            self._states[message.process] = message.state
            if message.process == "cmr-sim":
                self._parameters_in_use = message.parameters_sha256

    def _note_motion(self) -> None:
        for robot_id in (ROBOT, LEADER, FOLLOWER):
            robot = self._world.robot(robot_id)
            if robot is not None and abs(robot.state.psi_left) + abs(robot.state.psi_right) > 0.2:
                self._last_motion = robot.utime

    def _resting(self) -> bool:
        return self._world.utime - self._last_motion > REST

    def _ready(self) -> bool:
        running = [name for name, state in self._states.items() if state == process_status_t.RUNNING]
        robots = all(self._world.robot(robot_id) is not None for robot_id in (ROBOT, LEADER, FOLLOWER))
        return robots and {"cmr-driver", "cmr-sim", "cmr-pilot", "cmr-calibrate", "cmr-emulate"} <= set(running)

    def _calibrated(self) -> bool:
        if self._calibration is not None and self._calibration.state == calibration_status_t.FAILED:
            raise CommandError(f"The calibration failed: {self._calibration.message}")
        return self._calibration is not None and self._calibration.state == calibration_status_t.DONE

    def _new_parameters_in_use(self) -> bool:
        return self._parameters_in_use not in ("", self._parameters_before)


def _report(folder: Path, settings: Settings) -> int:
    """Draw the figure and print the table."""
    drives = drives_of(folder / "run.lcm", ROBOT)
    if len(drives) < 2:
        raise CommandError(f"{folder}/run.lcm holds {len(drives)} drives instead of 2. See {folder}/*.txt.")
    before, after = before_and_after(drives)
    draw_before_and_after((before, after), folder / "figure_eight.png")
    print(_table(load(folder / f"robot_{ROBOT}.yaml"), settings.truth))
    print(verdict(before.path_rmse, after.path_rmse))
    if len(drives) > 2:
        print(
            f"The robot was stopped {len(drives) - 2} times on its way, because the computer did not keep up (see "
            f"{folder}/driver.txt); the path errors are those of the longest stretch of each drive."
        )
    print(
        f"Look at {folder}/figure_eight.png; the log is {folder}/run.lcm, the parameters are in "
        f"{folder}/robot_{ROBOT}.yaml."
    )
    return 0


def before_and_after(drives: Sequence[Drive]) -> tuple[Drive, Drive]:
    """Return the longest drives before and after the longest pause, which contains the calibration."""
    pauses = [after.utime[0] - before.utime[-1] for before, after in pairwise(drives)]
    second = int(np.argmax(pauses)) + 1
    parts = drives[:second], drives[second:]
    before, after = (max(part, key=lambda one: float(one.utime[-1] - one.utime[0])) for part in parts)
    return before, after


def _table(found: ParameterFile, truth: dict[str, float]) -> str:
    lines = [f"{'parameter':12s} {'unit':8s} {'nominal':>9s} {'true':>9s} {'found':>9s} {'std':>9s} {'error':>8s}"]
    for name, true in truth.items():
        value = found.values[name]
        std = "-" if value.std is None else f"{value.std:9.2g}"
        lines.append(
            f"{name:12s} {DEFINITIONS[name].unit:8s} {NOMINAL[name]:9.4g} {true:9.4g} {value.value:9.4g} {std:>9s} "
            f"{100.0 * (value.value / true - 1.0):+7.2f} %"
        )
    return "\n".join(lines)


def verdict(before: float, after: float) -> str:
    """Describe the change of the path error [m]; a drive on a busy computer may be inconclusive."""
    change = f"{before / after:.0f} times smaller" if after < before else "no smaller"
    return (
        f"Path error between the robot and its simulated twin: {before:.3f} m before calibration, {after:.3f} m after: "
        f"{change}."
    )
