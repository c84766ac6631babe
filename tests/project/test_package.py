"""A wheel holds all that runs, nothing that collides with other people's packages, and nothing made by hand."""

import ast
import configparser
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from setuptools.config.pyprojecttoml import read_configuration

from cmr import msg
from tests.support.project import PROJECT

pytestmark = pytest.mark.slow

# What pip says when it cannot fetch the build's requirements.
NO_NETWORK = re.compile(r"NewConnectionError|Temporary failure in name resolution|Failed to establish a new connection")


def git(*arguments: str) -> list[str]:
    """Return the lines that git prints; skip where this is no clone."""
    if not shutil.which("git") or not (PROJECT / ".git").exists():
        pytest.skip("this is not a git clone")
    result = subprocess.run(["git", *arguments], cwd=PROJECT, capture_output=True, text=True, check=True)
    return result.stdout.splitlines()


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what git tracks: the build leaves its traces there."""
    folder = tmp_path_factory.mktemp("sources")
    for name in git("ls-files"):
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (PROJECT / name).exists():  # not deleted here and still tracked
            shutil.copy2(PROJECT / name, target)
    return folder


@pytest.fixture(scope="module")
def wheel(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that `pip wheel` builds, unpacked."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", str(folder), str(sources)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    said = result.stdout + result.stderr
    if result.returncode != 0 and NO_NETWORK.search(said):
        pytest.skip("pip cannot fetch the build requirements: no network")
    assert result.returncode == 0, said
    [archive] = folder.glob("*.whl")
    unpacked = folder / "unpacked"
    with zipfile.ZipFile(archive) as content:
        content.extractall(unpacked)
    return unpacked


def names(folder: Path, pattern: str) -> set[str]:
    return {path.name for path in folder.glob(pattern)}


def test_the_wheel_installs_our_three_packages_and_nothing_else(wheel: Path) -> None:
    top = {path.name for path in wheel.iterdir()}
    [information] = [name for name in top if name.endswith(".dist-info")]
    assert top == {"cmr", "cmr_tools", "robot_driver", information}
    assert (wheel / information / "top_level.txt").read_text().split() == ["cmr", "cmr_tools", "robot_driver"]


def test_the_wheel_holds_every_module_and_data_file(wheel: Path, sources: Path) -> None:
    def parts(folder: Path) -> set[str]:
        found = {path for path in folder.rglob("*") if path.suffix in {".py", ".yaml"} or path.name == "py.typed"}
        return {str(path.relative_to(folder)) for path in found if "__pycache__" not in path.parts}

    generated = {f"msg/{name}" for name in names(wheel / "cmr" / "msg", "*.py")}
    assert parts(wheel / "robot_driver") == parts(sources / "robot_driver")
    assert parts(wheel / "cmr_tools") == parts(sources / "tools" / "cmr_tools")
    assert parts(wheel / "cmr") - generated == parts(sources / "cmr")
    assert {"py.typed", "importing/import_log.py", "importing/mappings/mbot.yaml"} <= parts(wheel / "cmr_tools")
    assert {"py.typed", "emulator/default.yaml"} <= parts(wheel / "robot_driver")


def test_the_build_makes_a_message_class_of_every_type(wheel: Path, sources: Path) -> None:
    types = {f"{path.stem}.py" for path in (sources / "lcmtypes").glob("*.lcm")}
    assert names(wheel / "cmr" / "msg", "*.py") == types | {"__init__.py"}


def test_a_stub_beside_each_message_class_types_its_fields(wheel: Path, sources: Path) -> None:
    stubs = {path.stem: path.read_text() for path in (wheel / "cmr" / "msg").glob("*.pyi")}
    assert set(stubs) == {path.stem for path in (sources / "lcmtypes").glob("*.lcm")}
    assert "    x: Sequence[float] | NDArray[float64]\n" in stubs["waypoints_t"]
    assert "    jpeg: bytes\n" in stubs["camera_image_t"]
    assert "    FAILED: ClassVar[int] = 4\n" in stubs["calibration_status_t"]


def test_every_command_of_the_wheel_is_a_function_there(wheel: Path) -> None:
    [listed] = wheel.glob("*.dist-info/entry_points.txt")
    entries = configparser.ConfigParser()
    entries.read(listed)
    commands = dict(entries["console_scripts"])
    declared = (PROJECT / "pyproject.toml").read_text().partition("[project.scripts]\n")[2].partition("\n\n")[0]
    assert sorted(commands) == sorted(re.findall(r"^(cmr[a-z0-9-]*) =", declared, re.MULTILINE))
    # What a command loads is given in cmr.commands as the name of a module; see that the wheel has it.
    script = (
        "import sys, importlib, unittest.mock as mock; sys.path.insert(0, sys.argv[1]); import cmr.commands\n"
        "assert cmr.commands.__file__.startswith(sys.argv[1]), cmr.commands.__file__\n"
        "for entry in sys.argv[2:]:\n"
        "    module, _, function = entry.partition(':')\n"
        "    with mock.patch('cmr.commands.run') as run:\n"
        "        getattr(importlib.import_module(module), function)()\n"
        "    main = importlib.import_module(run.call_args.args[0])\n"
        "    assert main.__file__.startswith(sys.argv[1]), main.__file__\n"
        "    assert callable(main.main)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script, str(wheel), *commands.values()],
        cwd=wheel,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr


def test_nothing_that_is_generated_is_tracked() -> None:
    assert git("ls-files", "cmr/msg") == []
    generated = re.compile(r"__pycache__|\.egg-info|\.pyc$|^build/|^dist/|^\.venv/|_cache/")
    assert [name for name in git("ls-files") if generated.search(name)] == []


def test_no_tracked_file_is_a_link() -> None:
    """An archive and a file system without links hold the whole project, and each file has one path."""
    assert [line for line in git("ls-files", "--stage") if line.startswith("120000")] == []


def test_python_in_a_checkout_finds_the_message_classes_of_the_installed_package(wheel: Path, sources: Path) -> None:
    """As after `pip install .`: the folder in which Python runs comes before what is installed."""
    run = [sys.executable, "-c", "import sys; sys.path.append(sys.argv[1]); from cmr import msg; print(msg.__file__)"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    bare = shutil.copytree(sources / "cmr", sources / "bare" / "cmr", ignore=shutil.ignore_patterns("msg"))
    command = [run[0], "-S", *run[1:]]  # without the editable installation that runs this test
    found = subprocess.run(
        [*command, str(wheel)], cwd=bare.parent, env=environment, capture_output=True, text=True, check=True
    )
    assert Path(found.stdout.strip()) == wheel / "cmr" / "msg" / "__init__.py"
    missing = subprocess.run(
        [*command, str(bare / "bus")], cwd=bare.parent, env=environment, capture_output=True, text=True, check=False
    )
    assert "have not been generated in" in missing.stderr
    assert "pip install -e ." in missing.stderr


def test_the_metadata_name_the_licence_and_nobody_else_s_package(wheel: Path) -> None:
    [metadata] = wheel.glob("*.dist-info/METADATA")
    text = metadata.read_text()
    assert "\nName: calibrated-mixed-reality\n" in text
    assert "\nLicense-Expression: BSD-3-Clause\n" in text
    assert (metadata.parent / "licenses" / "LICENSE").is_file()
    assert not re.search(r"^Requires-Dist: cmr\b", text, re.MULTILINE)


@pytest.mark.parametrize("extra", ["docs", "test"])
def test_the_extras_whose_programs_read_pyproject_toml_bring_a_setuptools_that_can(extra: str) -> None:
    """A new environment has one of Python's own: 65.5 with 3.11, which refuses the licence."""
    content = read_configuration(PROJECT / "pyproject.toml", expand=False)
    [needed] = [one for one in content["build-system"]["requires"] if one.startswith("setuptools")]
    assert needed in content["project"]["optional-dependencies"][extra]


def test_no_text_says_to_install_the_stranger_s_package() -> None:
    """The package index has a "cmr" that is not this one."""
    stranger = re.compile(r"pip3? install [^\n`]*['\" ]cmr\b(?!-)")
    texts = [PROJECT / name for name in git("ls-files") if name.endswith((".md", ".py", ".sh", ".toml"))]
    texts = [path for path in texts if path != Path(__file__).resolve() and path.name != "CHANGELOG.md"]
    assert [path.name for path in texts if path.is_file() and stranger.search(path.read_text())] == []


@pytest.mark.parametrize("path", sorted((Path(msg.__file__).parent).glob("*_t.py")), ids=lambda path: path.stem)
def test_the_fields_and_constants_of_a_stub_are_those_of_its_class(path: Path) -> None:
    message_type = getattr(msg, path.stem)
    [*_, stub] = ast.parse(path.with_suffix(".pyi").read_text()).body
    assert isinstance(stub, ast.ClassDef)
    annotated = [node for node in stub.body if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)]
    typed = {node.target.id: node for node in annotated if isinstance(node.target, ast.Name)}
    fields = [name for name in typed if name.islower() and not name.startswith("__")]
    assert fields == message_type.__slots__
    constants = {name: ast.literal_eval(node.value) for name, node in typed.items() if node.value is not None}
    assert constants == {name: value for name, value in vars(message_type).items() if name.isupper()}
    for name in fields:
        holds = ast.unparse(typed[name].annotation)
        assert type(getattr(message_type(), name)).__name__ in (holds, "list" if "Sequence" in holds else holds)
