"""Every code block of README and docs/ works: it is run, or read by what would read it."""

import ast
import re
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import yaml
from setuptools.config.pyprojecttoml import read_configuration

from cmr.commands import scenarios
from cmr.exporting.command import main as export
from cmr.model.catalogue import LAWS, unlearn
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.file import parse as parse_parameters
from cmr.parameters.laws import parse_law
from cmr.tracker.profile import Profile
from robot_driver.emulator.settings import load_settings
from robot_driver.ros2.profile import Profile as Ros2Profile
from tests.documentation.turtlebot_bag import write_turtlebot_bag
from tests.support.documentation_blocks import DOCS, Block, Line, blocks, blocks_of, command_lines, pages
from tests.support.emulated_drive import IDEAL, messages, write_log
from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from documentation.commands import main_of, modules, parse

pytestmark = pytest.mark.slow

LANGUAGES = {"sh", "python", "yaml", "toml", "text"}
# Command lines of CMR that are parsed and not run here, by how they begin, and why.
ONLY_PARSED = {
    "cmr accept": "needs a robot; tests/robot_driver/acceptance runs it",
    "cmr-calibrate --robot": "listens to a robot on the bus",
    "cmr-camera 0": "needs a camera",
    "cmr-camera calibrate": "needs a camera",
    "cmr-diagnose --live": "listens to a robot on the bus",
    "cmr-diagnose next.lcm --laws": "as the diagnosis of one log, which is run",
    "cmr-diagnose next.lcm --held-out": "tests/documentation/test_unwritten_physics.py runs it",
    "cmr-diagnose run.lcm --held-out other.lcm": "tests/documentation/test_unwritten_physics.py runs it",
    "cmr-diagnose run.lcm next.lcm": "as the diagnosis of one log, which is run",
    "cmr-diagnose runs": "as the diagnosis of one log, which is run",
    "cmr-driver": "needs a robot on a serial port",
    "cmr-emulate": "runs until it is stopped",
    "cmr-fidelity": "takes minutes; tests/experiments/fidelity/test_fidelity.py runs it",
    "cmr-import optiodom": "needs a recording of OptiOdom; tests/tools/importing/test_real_recordings.py has one",
    "cmr-laws diagnosis": "tests/documentation/test_unwritten_physics.py runs it",
    "cmr-laws diagnoses": "tests/diagnosis/test_collection.py runs it on parameter files with laws",
    "cmr-investigate --robot": "commands a robot on the bus",
    "cmr-pilot": "commands a robot on the bus",
    "cmr-plot run.lcm": "opens a window",
    "cmr-replay run.lcm --remap": "takes as long as the log",
    "cmr-replay run.lcm --start": "repeats until it is stopped",
    "cmr-run line": "takes half a minute; tests/experiments/live/test_run.py runs scenarios",
    "cmr-run lab.yaml": "needs rclpy; tests/robot_driver/ros2/test_scenario.py runs such a scenario",
    "cmr-run pair.yaml": "takes half a minute; its scenario is read here",
    "cmr-sim --parameters": "runs until it is stopped",
    "cmr-sim --real": "runs until it is stopped",
    "cmr-sim --virtual": "runs until it is stopped",
    "cmr-spy": "listens for 5 s; tests/tools/test_spy.py runs it",
    "cmr-sweep": "takes minutes; tests/experiments/sweep/test_sweep.py runs it",
    "cmr-agent": "runs until it is stopped; tests/whole/test_agent_on_another_host.py runs it",
    "cmr key new": "makes a key for this user; tests/commands/test_key_and_relay.py makes one",
    "cmr relay": "runs until it is stopped; tests/commands/test_key_and_relay.py runs its parts",
    "cmr bringup": "needs a robot, and somebody who answers; tests/robot_driver/bringup runs it",
    "cmr estop": "stops robots on the bus; tests/robot_driver/test_latched_stop.py runs it",
    "cmr-tracker --profile": "needs a motion capture system; tests/tracker runs it",
    "cmr-ros2": "needs rclpy; tests/robot_driver/ros2/test_page.py runs the page",
    "cmr-teleop": "commands a robot on the bus; tests/teleop runs it",
    "cmr demo --lead": "needs a person; tests/whole/test_lead.py runs it with a script",
    "cmr-view": "serves a page until it is stopped",
}
ALONE = ("cmr-calibrate", "cmr-sim")  # without any option they listen until they are stopped
# Programs of others, which need root, the network, ROS or a bus; and the shell's own words.
NOT_OURS = {
    "sudo",
    "pip",
    ".venv/bin/pip",
    ".venv/bin/pytest",
    "python3",
    "lcm-logger",
    "journalctl",
    "ros2",
    "dask",
    "export",
    "kill",
    ".",
    "cd",
}
# Python that is no program by itself, and the test that has it.
EXCERPTS = {
    "docs/effects.md": "the equations of the catalogue: tests/model/test_effects_document.py",
    "docs/tutorials/unwritten_physics.md": "drives for a minute: tests/documentation/test_unwritten_physics.py",
    "docs/how_to/add_an_effect.md": "needs a package with an entry point: tests/model/test_effects.py",
}


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the pages speak of."""
    folder = tmp_path_factory.mktemp("bench")
    drive = messages(IDEAL, seconds=20.0)
    (folder / "demo-run").mkdir()
    for name in ("run.lcm", "before.lcm", "after.lcm", "demo-run/run.lcm"):
        write_log(folder / name, drive)
    for name in ("robot.lcm", "laptop.lcm"):
        write_log(folder / name, messages(IDEAL, seconds=2.0))
    values = {"wheel_radius": 0.04, "k2_over_k3": 100.0, "k1": 0.06, "base_width": 0.17}
    ParameterFile(0, {name: Value(value) for name, value in values.items()}).save(folder / "robot_0.yaml")
    for target, name in (("python", "robot_0.py"), ("mjcf", "robot_0.xml")):
        export([str(folder / "robot_0.yaml"), "--to", target, "--out", str(folder / name)])
    write_turtlebot_bag(folder).rename(folder / "rosbag2_2026_11_22-14_00_00")
    return folder


def only_parsed(line: Line) -> bool:
    return line.text in ALONE or line.text.startswith(tuple(ONLY_PARSED))


def exit_code(main: Callable[[list[str]], object], arguments: list[str]) -> object:
    """Return what `main` returns, or that with which it ends the process, as --version does."""
    try:
        return main(arguments)
    except SystemExit as end:
        return end.code


OURS = [line for line in command_lines() if line.words[0] in modules()]
RUN = [line for line in OURS if not only_parsed(line)]


def test_every_command_line_is_understood_by_the_command() -> None:
    for line in OURS:
        assert exit_code(partial(parse, line.words[0]), line.words[1:]) in (None, 0), str(line)


@pytest.mark.parametrize("page", sorted({line.block.page for line in RUN}))
def test_every_command_of_a_page_that_needs_no_hardware_does_its_work(
    page: str, bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, url: str
) -> None:
    shutil.copytree(bench, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LCM_DEFAULT_URL", url)
    for line in RUN:
        if line.block.page == page:
            assert exit_code(main_of(line.words[0]), line.words[1:]) == 0, str(line)


def test_the_list_of_what_is_only_parsed_names_nothing_else() -> None:
    unused = [start for start in ONLY_PARSED if not any(line.text.startswith(start) for line in OURS)]
    assert not unused


def test_every_other_program_is_known_and_every_script_is_here() -> None:
    extras = read_configuration(PROJECT / "pyproject.toml")["project"]["optional-dependencies"]
    for line in command_lines():
        program, *arguments = line.words
        if program.startswith("scripts/"):
            text = (PROJECT / program).read_text("utf-8") + (PROJECT / "cmr/commands/demo.py").read_text("utf-8")
            assert all(option in text for option in arguments if option.startswith("--")), str(line)
        else:
            assert program in NOT_OURS or line in OURS, str(line)
        assert {*re.findall(r"\.\[(\w+)\]", line.text)} <= {*extras}, str(line)
        assert "pip install cmr" not in line.text, f"{line}: that is somebody else's package"


def test_every_block_says_its_language() -> None:
    found = [block for page in pages() for block in blocks_of(page)]
    wrong = [str(block) for block in found if block.language not in LANGUAGES and not block.language.startswith("{")]
    assert len(found) > 100
    assert not wrong


@pytest.mark.parametrize("page", sorted({block.page for block in blocks("python")}))
def test_the_python_of_a_page_runs_from_its_first_block_to_its_last(
    page: str, bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bench)
    monkeypatch.syspath_prepend(str(bench))
    names: dict[str, object] = {"__name__": "page"}
    for block in blocks("python"):
        if block.page != page:
            continue
        if page in EXCERPTS:
            ast.parse(block.text)
        else:
            exec(compile(block.text, str(block), "exec"), names)


@pytest.mark.parametrize("block", blocks("yaml"), ids=str)
def test_yaml_is_read_by_what_would_read_it(block: Block, bench: Path, tmp_path: Path) -> None:
    content = yaml.safe_load(block.text)
    readers: dict[str, Callable[[], object]] = {
        "robots": lambda: scenarios.parse(block.text, str(block), shown_before(block, tmp_path) or bench),
        "schema": lambda: parse_parameters(block.text, str(block)),
        "effects": lambda: load_settings(written(tmp_path / "settings.yaml", block.text)),
        "mounting": lambda: load_settings(written(tmp_path / "settings.yaml", block.text)),
    }
    if "tracker" in content:
        readers = {"tracker": lambda: Profile.parse(block.text)}
    if "wheels" in content:
        readers = {"wheels": lambda: Ros2Profile.parse(block.text)}
    if "law" in content:
        readers = {"law": lambda: parse_law(block.text, str(block))}
    if "laws" in content:
        readers = {"schema": lambda: parse_parameters(block.text, str(block))}
    known = set(LAWS)
    used = [read() for key, read in readers.items() if key in content]
    for name in set(LAWS) - known:
        unlearn(name)
    assert used or block.page in (
        "tools/cmr_tools/importing/mappings/README.md",
    )  # its examples leave out what "..." stands for


def shown_before(block: Block, folder: Path) -> Path | None:
    """Write the files of a ROS 2 robot that its page shows, and return the folder; None for other blocks."""
    if "ros2:" not in block.text:
        return None
    for other in blocks_of(PROJECT / block.page):
        if other.language == "yaml" and "schema:" in other.text:
            written(folder / ("my_robot.yaml" if "wheels:" in other.text else "robot_0.yaml"), other.text)
    return folder


def written(path: Path, text: str) -> Path:
    path.write_text(text, "utf-8")
    return path


@pytest.mark.parametrize("block", blocks("toml"), ids=str)
def test_toml_is_a_pyproject_file_with_entry_points_that_cmr_looks_for(block: Block, tmp_path: Path) -> None:
    path = written(tmp_path / "pyproject.toml", block.text)
    content = read_configuration(path, expand=False, ignore_option_errors=True)
    assert {*content["project"]["entry-points"]} <= {"cmr.effects", "cmr.behaviours"}


def test_the_front_page_shows_the_example_that_runs() -> None:
    example = (DOCS / "effect_of_your_own.py").read_text("utf-8")
    shown = [block.text for page in ("index.md", "how_to/add_an_effect.md") for block in blocks_of(DOCS / page)]
    assert shown.count(example) == 2
