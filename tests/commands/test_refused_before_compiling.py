"""What can be refused is refused at once: not after a minute in which the first use of a computer compiles."""

from collections.abc import Callable
from pathlib import Path

import pytest

from cmr.bus.preflight import BusError
from cmr.commands import first_use
from cmr.commands.calibrate import main as calibrate
from cmr.commands.command_line import CommandError
from cmr.commands.demo import main as demo
from cmr.commands.diagnose import main as diagnose
from cmr.commands.run import main as run
from cmr.commands.sim import DEFAULT_PARAMETERS
from cmr.commands.sim import main as sim
from cmr.commands.sweep import main as sweep
from tests.support.emulated_drive import IDEAL, messages, write_log

NO_BUS = "udpm://10.0.0.1:7667"  # no multicast address
Main = Callable[[list[str]], int]
REFUSED: list[tuple[Main, str, str]] = [
    (run, f"line --lcm-url {NO_BUS}", "not a multicast address"),
    (run, "line --out a_file/results", "a_file is a file, not a folder"),
    (run, "elsewhere.yaml --lcm-url udpm://239.255.76.67:7667?ttl=0", "does not leave this machine"),
    (sim, f"--lcm-url {NO_BUS}", "not a multicast address"),
    (sim, "--virtual 3=nobody", "There is no behaviour 'nobody'"),
    (sim, "--virtual 3=figure_eight --population nothing.yaml", "nothing.yaml"),
    (diagnose, f"--live --lcm-url {NO_BUS}", "not a multicast address"),
    (diagnose, "nothing.lcm --out found", "nothing.lcm: cannot be opened"),
    (diagnose, "run.lcm --robot 9 --out found", "nothing measured of robot 9"),
    (diagnose, "run.lcm --out a_file", "a_file: cannot be written: it is a file, not a folder"),
    (calibrate, "nothing.lcm", "nothing.lcm: cannot be opened"),
    (calibrate, "--log a_file", "no MOTOR_FEEDBACK_N or POSE_N in it"),
    (calibrate, "run.lcm --robot 9", "nothing measured of robot 9"),
    (calibrate, "run.lcm --out a_file/robot_0.yaml", "a_file: cannot be written: it is a file, not a folder"),
    (calibrate, "run.lcm --picture nowhere/found.png", "nowhere is not a folder"),
    (demo, f"--lcm-url {NO_BUS}", "not a multicast address"),
    (demo, "--out a_file", "a_file: cannot be written: it is a file, not a folder"),
    (sweep, "line --seeds 1 --out a_file", "a_file: cannot be written: it is a file, not a folder"),
]
ELSEWHERE = """
duration: 5
parameters: robot_0.yaml
robots:
  - {id: 0, kind: real, host: another, driver: {port: /dev/ttyUSB0}, behaviour: follow}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, on a computer where nothing is compiled, and nothing must be."""

    def compile_nothing(name: str, _mark: Path) -> str:
        raise AssertionError(f"compiles {name} before it refuses")

    monkeypatch.chdir(tmp_path)
    (tmp_path / "cache").mkdir()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(first_use, "_compile", compile_nothing)
    (tmp_path / "a_file").write_text("")
    (tmp_path / "elsewhere.yaml").write_text(ELSEWHERE)
    (tmp_path / "robot_0.yaml").write_text(DEFAULT_PARAMETERS.read_text())
    write_log(tmp_path / "run.lcm", messages(IDEAL, seconds=4.0, rest=0.5))
    return tmp_path


@pytest.mark.parametrize(("main", "arguments", "reason"), REFUSED, ids=[f"{m.__module__}-{a}" for m, a, _ in REFUSED])
def test_refused_before_anything_is_compiled(main: Main, arguments: str, reason: str, folder: Path) -> None:
    before = sorted(folder.rglob("*"))
    with pytest.raises((CommandError, BusError), match=reason):
        main(arguments.split())
    assert sorted(folder.rglob("*")) == before, "a command that fails leaves nothing behind"
