"""Every command explains itself, fails in one line that says what to do, and ends quietly on Ctrl-C."""

import argparse
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path

import cv2
import lcm
import numpy as np
import pytest

from cmr.bus.preflight import BusError
from cmr.camera.lens import Lens
from cmr.cli.command_line import guarded, parse_robot_id, parser
from cmr.cli.configuration import LARGEST_ROBOT_ID
from cmr.cli.errors import CommandError
from cmr.distribution import NAME, version
from cmr.recordings.events import event_bytes
from tests.support.commands import Commands, commands
from tests.support.project import PROJECT
from tests.support.small_log import small_log

pytestmark = pytest.mark.slow

COMMANDS = sorted(
    entry.name
    for entry in distribution(NAME).entry_points
    if entry.group == "console_scripts" and entry.name != "cmr"  # which starts the others: test_umbrella.py
)
LOGS_ALONE = ("cmr-log", "cmr-plot")  # these need no LCM
# These end by themselves; cmr-ros2 does where no rclpy is installed.
WITHOUT_BUS = ("cmr-export", "cmr-import", "cmr-fidelity", "cmr-laws", "cmr-log", "cmr-plot", "cmr-ros2", "cmr-sweep")
SERVICES = [name for name in COMMANDS if name not in WITHOUT_BUS]
NEEDED = {
    "cmr-agent": ["--insecure"],
    "cmr-camera": ["0"],
    "cmr-driver": ["--port", "/dev/null"],
    "cmr-export": ["robot_0.yaml", "--to", "python"],
    "cmr-fidelity": ["line.yaml", "--out", "fidelity"],
    "cmr-investigate": ["--out", "found"],
    "cmr-laws": ["robot_0.yaml"],
    "cmr-log": ["info", "run.lcm"],
    "cmr-plot": ["run.lcm", "POSE_0.x"],
    "cmr-replay": ["run.lcm"],
    "cmr-ros2": ["--profiles"],
    "cmr-sweep": ["line.yaml"],
}
NO_GLIB = 'raise ImportError("libglib-2.0.so.0: cannot open shared object file: No such file or directory")\n'
PATIENCE = 30.0  # s


def command_line(name: str, folder: Path, url: str) -> list[str]:
    """Return a command line with which the command starts to work."""
    options = {
        "cmr-agent": ["--insecure"],
        "cmr-camera": [str(endless_pictures(folder)), "--rate", "0.01", "--lens", "lens.yaml", "--floor", "floor.yaml"],
        "cmr-driver": ["--port", silent_port()],
        "cmr-emulate": ["--ports", str(folder / "ports")],
        "cmr-demo": ["--out", str(folder / "demo")],
        "cmr-diagnose": ["--live"],
        "cmr-investigate": ["--out", str(folder / "found")],
        "cmr-replay": [str(short_log(folder / "run.lcm")), "--loop"],
        "cmr-run": ["line", "--out", str(folder / "run")],
        "cmr-tracker": ["--profile", str(no_tracker(folder / "tracker.yaml"))],
    }
    return [str(Path(sys.executable).parent / name), "--lcm-url", url, *options.get(name, [])]


def short_log(path: Path) -> Path:
    """Write an event log of two messages, a second apart."""
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for utime in (1, 1_000_001):
        log.write_event(utime, "ANYTHING", b"")
    log.close()
    return path


def no_tracker(path: Path) -> Path:
    """Write a profile of a tracker that does not answer."""
    path.write_text("schema: 1\ntracker: {type: vrpn, server: 127.0.0.1, port: 9}\nrobots: {0: {body: a}}\n")
    return path


def endless_pictures(folder: Path) -> Path:
    """Return a folder of two small pictures, and write beside it what cmr-camera wants to know of lens and floor."""
    Lens(64, 48, 50.0, 50.0, 32.0, 24.0).save(folder / "lens.yaml")
    tags = "".join(f"  {number}: {{x: {number}, y: 0, theta: 0}}\n" for number in range(4))
    (folder / "floor.yaml").write_text(f"schema: 1\ntag_size: 0.1\ntags:\n{tags}")
    (folder / "pictures").mkdir()
    for name in "ab":
        cv2.imwrite(str(folder / "pictures" / f"{name}.png"), np.zeros((48, 64), np.uint8))
    return folder / "pictures"


def silent_port() -> str:
    """Return a serial port on which nothing ever answers; it is there until this process ends."""
    _master, slave = os.openpty()
    return os.ttyname(slave)


def run(name: str, *arguments: str, path: Path | None = None) -> "subprocess.CompletedProcess[str]":
    """Run a command to its end; modules in `path` come before all others."""
    environment = {**os.environ, "COLUMNS": "80"}
    if path is not None:
        environment["PYTHONPATH"] = str(path)
    program = str(Path(sys.executable).parent / name)
    return subprocess.run(
        [program, *arguments], env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False
    )


@pytest.fixture(scope="module")
def asked() -> Iterator[Commands]:
    with commands() as all_of_them:
        yield all_of_them


def test_the_commands_of_the_interface_are_there() -> None:
    assert {"cmr-sim", "cmr-driver", "cmr-calibrate", "cmr-demo", "cmr-diagnose", "cmr-emulate", "cmr-import"} <= set(
        COMMANDS
    )
    assert all(name.startswith("cmr-") for name in COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_an_example_and_the_options_that_all_commands_have(name: str, asked: Commands) -> None:
    result = asked.run(name, "--help")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith(f"usage: {name} ")
    assert re.search(rf"^example:\n  {name} ", result.stdout, re.MULTILINE)
    assert "--lcm-url URL" in result.stdout
    assert "--version" in result.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_help_reads_well(name: str, asked: Commands) -> None:
    text = asked.run(name, "--help").stdout
    assert "default: None" not in text
    assert "default: False" not in text
    assert "default: True" not in text
    assert ") (default" not in text, "a default is told twice"
    assert "default: []" not in text
    before_the_example = text.partition("\nexample:\n")[0]
    assert max(map(len, before_the_example.splitlines())) <= 80
    purpose = before_the_example.split("\n\n")[1]
    assert re.match(r"[A-Z].*[.:]", purpose, re.DOTALL), "the purpose is a sentence"
    options = re.findall(r"^  (?:-\w, )?(--[a-z-]+)", text, re.MULTILINE)
    explained = re.findall(r"^  (?:-\w, )?(--[a-z-]+)(?: [^\n]*?)?(?:  +|\n {8,})\S", text, re.MULTILINE)
    assert options == explained, "an option is not explained"


def test_defaults_are_shown_where_they_say_something() -> None:
    options = parser("cmr-x", "Do something.", "cmr-x")
    options.add_argument("--robot", type=int, default=0, help="robot id")
    options.add_argument("--out", type=Path, default=Path("run"), help="folder")
    options.add_argument("--split", action="store_true", help="in parts")
    text = options.format_help()
    assert "robot id (default: 0)" in text
    assert "folder (default: run)" in text
    assert text.count("default:") == 2


@pytest.mark.parametrize("text", ["-1", "2147483648", "1.0", "one", "", "\u0661"])
def test_a_robot_id_that_no_message_can_hold_is_wrong_usage(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="a robot id is a whole number of 0 to 2147483647"):
        parse_robot_id(text)
    assert (parse_robot_id("0"), parse_robot_id("2147483647")) == (0, LARGEST_ROBOT_ID)


@pytest.mark.parametrize("name", COMMANDS)
def test_version_is_that_of_the_package(name: str, asked: Commands) -> None:
    result = asked.run(name, "--version")
    assert (result.returncode, result.stdout, result.stderr) == (0, f"{name} {version()}\n", "")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_wrong_option_is_named_and_exits_with_2(name: str, asked: Commands) -> None:
    result = asked.run(name, *NEEDED.get(name, []), "--no-such-option")
    assert (result.returncode, result.stdout) == (2, "")
    assert "--no-such-option" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("name", SERVICES)
def test_a_bus_that_cannot_be_used_is_one_line_and_exits_with_1(name: str, tmp_path: Path, asked: Commands) -> None:
    _program, *arguments = command_line(name, tmp_path, "udpm://10.0.0.1:7667")
    result = asked.run(name, *arguments, folder=tmp_path)
    assert result.returncode == 1
    (line,) = besides_compiling(result.stderr)
    assert line.startswith(f"{name}: 10.0.0.1 in 'udpm://10.0.0.1:7667' is not a multicast address.")


@pytest.mark.parametrize("error", [CommandError("What to do."), BusError("What to do.")])
def test_an_expected_error_is_one_line_and_exits_with_1(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    def fail(_arguments: list[str]) -> int:
        raise error

    assert guarded(fail, []) == 1
    assert re.fullmatch(r".*: What to do\.\n", capsys.readouterr().err)


def test_the_exit_code_of_a_command_is_handed_on() -> None:
    def interrupted(_arguments: list[str]) -> int:
        raise KeyboardInterrupt

    assert guarded(lambda arguments: len(arguments), ["a", "b"]) == 2
    assert guarded(interrupted, []) == 130


def test_a_command_whose_reader_has_ended_says_nothing_more() -> None:
    program = "import cmr.cli.command_line as c, sys; sys.exit(c.guarded(lambda _: print('x' * 100_000) or 0, []))"
    command = ["bash", "-c", '"$0" -c "$1" | true', sys.executable, program]
    result = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=True)
    assert result.stderr == ""


# Ctrl-C while a command is still starting


def besides_compiling(said: str) -> list[str]:
    """Return the lines but for those that announce what is compiled at the first use on this computer."""
    return [line for line in said.splitlines() if not line.startswith(("Compiling ", "Compiled "))]


def wait_for_python(process: "subprocess.Popen[str]") -> None:
    """Wait until our first line has run: it catches SIGTERM, which Python by itself does not."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        caught = re.search(r"^SigCgt:\s*(\w+)", Path(f"/proc/{process.pid}/status").read_text(), re.MULTILINE)
        assert process.poll() is None
        if caught and int(caught[1], 16) >> (signal.SIGTERM - 1) & 1:
            return
        time.sleep(0.001)
    raise AssertionError("the command does not catch SIGTERM")


@pytest.mark.parametrize("attempt", range(12))
def test_ctrl_c_while_starting_leaves_no_traceback_and_exits_with_130(attempt: int, url: str, tmp_path: Path) -> None:
    name = SERVICES[attempt % len(SERVICES)]
    moment = random.Random(attempt).uniform(0.0, 0.5)
    process = subprocess.Popen(
        command_line(name, tmp_path, url), cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    try:
        wait_for_python(process)
        time.sleep(moment)
        process.send_signal(signal.SIGINT if attempt % 4 else signal.SIGTERM)
        _, said = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130, f"{name} interrupted after {moment:.3f} s: {said}"
    # What it waits for, or why a run ends, it may have said; a traceback would begin otherwise.
    assert all(line.startswith((f"{name}: ", "Stopping: somebody ended it")) for line in besides_compiling(said)), said


def test_nothing_slow_is_loaded_before_ctrl_c_is_heard() -> None:
    script = "import sys; had = set(sys.modules); import cmr.commands; print(*set(sys.modules) - had)"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = set(result.stdout.split())
    assert "cmr.commands" in loaded
    assert not loaded & {"argparse", "importlib.metadata", "lcm", "numpy", "scipy", "typing", "yaml"}


# A machine without GLib


@pytest.fixture
def without_glib(tmp_path: Path) -> Path:
    """A folder of modules in which LCM is as on a machine without GLib."""
    package = tmp_path / "modules" / "lcm"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(NO_GLIB)
    return package.parent


# The others write logs and exports, and read parameter files, without LCM.
@pytest.mark.parametrize("name", sorted({*COMMANDS} - {*LOGS_ALONE, "cmr-import", "cmr-export", "cmr-laws"}))
def test_without_glib_a_command_says_in_one_line_what_to_install(name: str, without_glib: Path) -> None:
    # The help of a sweep needs no LCM, its plan does.
    arguments = [str(PROJECT / "cmr/experiments/scenario/shipped/line.yaml")] if name == "cmr-sweep" else ["--help"]
    result = run(name, *arguments, path=without_glib)
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr.startswith(f"{name}: LCM needs the system's library libglib-2.0.so.0")
    assert result.stderr.endswith("sudo apt-get install libglib2.0-0\n")
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize("name", LOGS_ALONE)
def test_without_glib_what_reads_logs_alone_reads_them(name: str, without_glib: Path, tmp_path: Path) -> None:
    log, picture = tmp_path / "run.lcm", tmp_path / "picture.png"
    log.write_bytes(b"".join(event_bytes(event) for event in small_log()))
    arguments = {"cmr-log": ["info", log], "cmr-plot": [log, "GYRO_4.yaw_rate", "--out", picture]}[name]
    result = run(name, *map(str, arguments), path=without_glib)
    assert result.returncode == 0, result.stderr
    assert "GYRO_4" in result.stdout or picture.exists()


def test_without_glib_the_build_says_in_one_line_what_to_install(without_glib: Path, tmp_path: Path) -> None:
    script = "from pathlib import Path; from scripts.build_messages import generate_messages as g; g(Path('.'))"
    environment = {**os.environ, "PYTHONPATH": f"{without_glib}:{PROJECT}"}
    result = subprocess.run(
        [sys.executable, "-c", script], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 1
    assert "sudo apt-get install libglib2.0-0" in result.stderr


def test_any_other_import_that_fails_is_not_blamed_on_glib(without_glib: Path) -> None:
    (without_glib / "lcm" / "__init__.py").write_text('raise ImportError("something else is wrong")\n')
    result = run("cmr-sim", "--help", path=without_glib)
    assert result.returncode == 1
    assert "something else is wrong" in result.stderr
    assert "apt-get" not in result.stderr
