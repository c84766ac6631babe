"""`cmr` starts any command, completes its options, sets up a robot and looks after the computer."""

import importlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cmr.bus.preflight import resolve_url
from cmr.cli import configuration
from cmr.cli.configuration import ConfigurationError
from cmr.commands import doctor, init
from cmr.commands.catalogue import COMMANDS, UMBRELLA_ONLY
from cmr.commands.completion import SHELLS, script
from cmr.commands.scenarios import load as load_scenario
from cmr.distribution import DRIVER_NAME, NAME
from cmr.parameters.file import load
from robot_driver.controllers import CONTROLLERS
from robot_driver.gyros import GYROS
from tests.support.project import PROJECT

pytestmark = pytest.mark.slow

COMPLETE = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
function=$(complete -p "$1"); function=${function#*-F }; ${function%% *}
printf '%s\\n' "${COMPREPLY[@]}"
"""


def cmr(*arguments: str, url: str = "memq://") -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "cmr", *arguments]
    environment = {**os.environ, "LCM_DEFAULT_URL": url}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60.0, check=False)


def test_help_lists_every_command_and_the_exit_codes() -> None:
    said = cmr("--help").stdout
    assert all(f"\n  {name} " in said for name in COMMANDS)
    assert "exit codes:\n  0    done" in said


def test_help_loads_nothing_slow() -> None:
    program = (
        "import sys; from cmr.commands.umbrella import main; main(['--help']); print(*sys.modules, file=sys.stderr)"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not {"numba", "matplotlib", "scipy", "rich", "shtab"} & set(result.stderr.split())


def test_a_command_under_the_umbrella_is_the_one_with_its_own_name() -> None:
    assert cmr("log", "--help").stdout.startswith("usage: cmr-log ")
    wrong = cmr("log", "info", "no-such-log.lcm")
    assert (wrong.returncode, wrong.stderr) == (1, "cmr-log: no-such-log.lcm: No such file or directory\n")


def test_a_command_that_does_not_exist_is_wrong_usage_and_the_nearest_is_named() -> None:
    result = cmr("calibrat")
    assert result.returncode == 2
    assert "Did you mean calibrate?" in result.stderr


def test_every_command_of_the_package_is_under_the_umbrella() -> None:
    text = (PROJECT / "pyproject.toml").read_text()
    own = {line.split(" = ")[0] for line in text.splitlines() if line.startswith("cmr-") and " = " in line}
    assert own == {f"cmr-{name}" for name in COMMANDS if name not in UMBRELLA_ONLY}


def test_a_driver_alone_lists_what_it_has_and_says_where_the_rest_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    umbrella = importlib.import_module("cmr.commands.umbrella")  # its package has a function of that name
    monkeypatch.setattr(umbrella, "has_module", lambda name: name in ("robot_driver.main", "cmr.commands.estop"))
    assert umbrella.main(["--help"]) == 0
    listed = capsys.readouterr().out.partition("commands:\n")[2].partition("\n\n")[0]
    assert [line.split()[0] for line in listed.splitlines()] == ["driver", "estop"]
    assert umbrella.main(["sim"]) == 2
    assert "calibrated-mixed-reality-driver is installed, which has no sim" in capsys.readouterr().err


# Completion


@pytest.fixture(scope="module")
def bash_script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "cmr.bash"
    path.write_text(script("bash"))
    return path


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["cmr", "cali"], ["calibrate"]),
        (["cmr", "sim", "--parameters-"], ["--parameters-of"]),
        (["cmr-sim", "--parameters-"], ["--parameters-of"]),
        (["cmr", "driver", "--controller", "roboc"], ["roboclaw", "roboclaw-pair"]),
        (["cmr", "log", "inf"], ["info"]),
        (["cmr-log", "info", "FOLDER/cmr.b"], ["FOLDER/cmr.bash"]),
    ],
)
def test_bash_completes_commands_options_choices_and_files(
    bash_script: Path, words: list[str], expected: list[str]
) -> None:
    words = [word.replace("FOLDER", str(bash_script.parent)) for word in words]
    command = ["bash", "-c", COMPLETE, "bash", str(bash_script), *words]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout.split() == [word.replace("FOLDER", str(bash_script.parent)) for word in expected]


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_can_read_its_completion(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    path = tmp_path / f"cmr.{shell}"
    path.write_text(script(shell))
    subprocess.run([shell, "-n", str(path)], check=True)


# init


def test_what_init_writes_is_what_the_commands_read(tmp_path: Path) -> None:
    result = cmr("init", "--robot", "2", "--controller", "roboteq", "--gyro", "dsp3000", "--out", str(tmp_path))
    assert (result.returncode, result.stderr) == (0, "")
    assert load(tmp_path / "robot_2.yaml").robot_parameters.values["wheel_radius"] == 0.04
    scenario = load_scenario(tmp_path / "robot_2_scenario.yaml")
    robot = scenario.robot(2)
    assert robot is not None
    assert robot.driver is not None
    assert 'SYMLINK+="cmr-motor-2"' in (tmp_path / "60-cmr.rules").read_text()
    units = sorted(str(path) for path in tmp_path.glob("*.service"))
    assert len(units) == 2
    if shutil.which("systemd-analyze"):
        checked = subprocess.run(["systemd-analyze", "verify", *units], capture_output=True, text=True, check=False)
        assert str(tmp_path) not in checked.stderr


@pytest.mark.parametrize("controller", sorted(CONTROLLERS))
@pytest.mark.parametrize("gyro", ["none", *sorted(GYROS)])
def test_init_makes_a_sound_scenario_of_every_device(controller: str, gyro: str, tmp_path: Path) -> None:
    for name, text in init.contents(init.Answers(10, controller, gyro, 0.05, 0.3), tmp_path).items():
        (tmp_path / name).write_text(text)
    assert load_scenario(tmp_path / "robot_10_scenario.yaml").robot(10) is not None


def test_init_replaces_nothing_unasked(tmp_path: Path) -> None:
    (tmp_path / "robot_0.yaml").write_text("mine")
    result = cmr("init", "--out", str(tmp_path))
    assert result.returncode == 1
    assert "robot_0.yaml is there already. Choose another --out, or replace it with --force." in result.stderr
    assert (tmp_path / "robot_0.yaml").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["robot_0.yaml"]


def test_init_asks_again_for_what_it_cannot_use(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    answers = iter(["7", "steam", "mbot", "", "wide", "0.04", ""])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda _question: next(answers))
    assert init.main(["--out", str(tmp_path)]) == 0
    assert load(tmp_path / "robot_7.yaml").robot_id == 7
    said = capsys.readouterr().out
    assert "'steam' is not among them." in said
    assert "'wide' is not a length of 0.001 to 10 m." in said


# doctor


def test_doctor_says_of_each_part_how_it_is_and_exits_with_1_if_anything_is_red(url: str) -> None:
    result = cmr("doctor", "--json", "--lcm-url", url)
    findings = json.loads(result.stdout)
    assert list(findings) == list(doctor.checks(None))
    red = any(finding["colour"] == "red" for finding in findings.values())
    assert result.returncode == int(red)
    assert all(finding["remedy"] for finding in findings.values() if finding["colour"] != "green")


def test_doctor_finds_two_installations_in_one_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.installation().colour == doctor.GREEN
    monkeypatch.setattr(doctor, "installed", lambda: {NAME: "0.1.0", DRIVER_NAME: "0.1.0"})
    finding = doctor.installation()
    assert finding.colour == doctor.RED
    assert f"pip uninstall {NAME} {DRIVER_NAME}" in finding.remedy


def test_doctor_says_the_same_without_rich(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "rich.console", None)
    doctor._show({"bus": doctor.Finding(doctor.RED, "It is gone.", "Bring it back.")})
    assert capsys.readouterr().out == "red    bus  It is gone.\n            Bring it back.\n"


def test_doctor_is_red_for_a_bus_that_cannot_be_used() -> None:
    result = cmr("doctor", "--lcm-url", "udpm://10.0.0.1:7667")
    assert result.returncode == 1
    assert "not a multicast address" in " ".join(result.stdout.split())


def test_doctor_says_what_a_bus_without_buffer_loses_and_what_to_add(url: str) -> None:
    found = doctor.bus(url.partition("&recv_buf_size")[0])
    assert found.sentence == "The LCM URL sets no recv_buf_size: bursts will be lost."
    assert found.remedy.startswith("Add recv_buf_size=")


def test_doctor_names_the_ports_that_this_user_may_not_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robot_driver.serial_port.available_ports", lambda: ["/dev/no-such-port"])
    finding = doctor.permissions()
    assert finding.colour == doctor.RED
    assert "/dev/no-such-port" in finding.sentence
    assert "dialout" in finding.remedy


# Configuration


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    for variable in configuration.SETTINGS.values():
        monkeypatch.delenv(variable, raising=False)
    (tmp_path / "cmr").mkdir()
    return tmp_path / "cmr" / "config.yaml"


def test_command_line_comes_before_environment_before_file(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config.write_text("lcm_url: udpm://239.255.76.67:1\nrobot: 4\nparameters: robots\n")
    assert configuration.parameter_file(configuration.robot()) == Path("robots/robot_4.yaml")
    assert resolve_url(None).endswith(":1")
    monkeypatch.setenv("LCM_DEFAULT_URL", "udpm://239.255.76.67:2")
    monkeypatch.setenv("CMR_ROBOT", "5")
    assert resolve_url(None).endswith(":2")
    assert resolve_url("udpm://239.255.76.67:3").endswith(":3")
    assert configuration.robot() == 5


@pytest.mark.parametrize(
    ("text", "wrong"),
    [("speed: 3", "has speed; allowed are lcm_url, robot"), ("robot: -1", "a robot id is"), ("a: [", "is not YAML")],
)
def test_a_wrong_configuration_is_named_with_its_file(config: Path, text: str, wrong: str) -> None:
    config.write_text(text)
    with pytest.raises(ConfigurationError, match=f"config.yaml: .*{wrong}"):
        configuration.robot()
