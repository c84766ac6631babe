"""The driver alone, as scripts/release builds it: it is complete, small, confined and the same at each build."""

import email
import importlib
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from cmr.commands.init import Answers, contents
from tests.project.test_package import NO_NETWORK
from tests.support.lanes import further
from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
shipping_libraries: Any = importlib.import_module("shipping.libraries")
package: Any = importlib.import_module("shipping.package")
wheel: Any = importlib.import_module("shipping.wheel")

pytestmark = pytest.mark.slow

VERSION, EPOCH = "0.1.0", 1_700_000_000
PYTHON = f"{sys.version_info.major}.{sys.version_info.minor}"
LARGEST = {"amd64": 4e6, "arm64": 4e6}  # bytes on the disk, with the libraries of one Python; all five add 2.5 MB
MACHINES = {"amd64": 62, "arm64": 183}
HEAVY = {"numpy", "scipy", "numba", "rich", "matplotlib", "cattrs"}
# What runs in a command of the package, which knows no other path than Python's own and the tree.
BEGIN = "import sys; sys.path.insert(0, sys.argv.pop(1)); "
WHERE = "print(*{name.partition('.')[0] for name in sys.modules if not name.startswith('_')})"


class Built(NamedTuple):
    """A package, its tree as dpkg unpacks it, and the libraries that it was given."""

    path: Path
    tree: Path
    libraries: dict[str, bytes]

    @property
    def home(self) -> Path:
        return self.tree / str(package.HOME)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Built]:
    """Builds the package of an architecture once, for this Python alone."""
    if shutil.which("dpkg-deb") is None:
        pytest.skip("dpkg-deb is not installed")
    folder, done = tmp_path_factory.mktemp("package"), {}

    def build(architecture: str) -> Built:
        if architecture not in done:
            done[architecture] = _build(architecture, folder)
        return done[architecture]

    return build


def _build(architecture: str, folder: Path) -> Built:
    try:
        pip = [sys.executable, "-m", "pip"]
        wheels = shipping_libraries.download_wheels(pip, architecture, folder, (PYTHON,))
    except SystemExit as error:
        if NO_NETWORK.search(str(error)):
            pytest.skip("pip cannot fetch the libraries: no network")
        raise
    libraries = shipping_libraries.files_of(wheels, architecture)
    path = package.write_package(PROJECT, VERSION, architecture, libraries, folder, EPOCH)
    subprocess.run(["dpkg-deb", "-x", str(path), str(folder / f"{architecture}-tree")], check=True)
    return Built(path, folder / f"{architecture}-tree", libraries)


@pytest.fixture
def amd64(built: Callable[[str], Built]) -> Built:
    return built("amd64")


def run(program: str, home: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run a program as the package's commands run: with nothing on the path but Python's own and its modules."""
    command = [sys.executable, "-IS", "-c", BEGIN + program, str(home), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)


@pytest.mark.parametrize("architecture", [*further("amd64"), "arm64"])
def test_it_holds_what_it_should_for_its_processor_and_is_small(
    architecture: str, built: Callable[[str], Built]
) -> None:
    one = built(architecture)
    there = {path.relative_to(one.tree).as_posix(): path for path in one.tree.rglob("*") if path.is_file()}
    assert there.keys() == package.files_of_package(PROJECT, VERSION, one.libraries).keys()
    assert sum(path.stat().st_size for path in there.values()) < LARGEST[architecture]
    compiled = [path for name, path in there.items() if name.endswith(".so")]
    assert sorted(path.parent.name for path in compiled) == ["lcm", "yaml"]
    assert {shipping_libraries.machine_of(path.read_bytes()) for path in compiled} == {MACHINES[architecture]}
    assert {path.stat().st_mode & 0o777 for path in (one.tree / "usr" / "bin").iterdir()} == {0o755}


@pytest.mark.parametrize("module", ["robot_driver.main", "cmr.commands.agent"])
def test_its_services_need_nothing_else(module: str, amd64: Built) -> None:
    result = run(f"import {module}; {WHERE}", amd64.home)
    assert result.returncode == 0, result.stderr
    imported = set(result.stdout.split())
    assert imported <= {*sys.stdlib_module_names, "cmr", "robot_driver", "lcm", "serial", "yaml", "cython_runtime"}
    assert not imported & HEAVY
    assert run("import yaml; yaml.CSafeLoader", amd64.home).returncode == 0


@pytest.mark.parametrize(
    "command", ["driver --help", "estop --help", "key --help", "relay --help", "agent --help", "doctor --json"]
)
def test_its_commands_start(command: str, amd64: Built) -> None:
    umbrella = "sys.argv[0] = 'cmr'; from cmr.commands import umbrella; sys.exit(umbrella())"
    result = run(umbrella, amd64.home, *command.split(), "--lcm-url", "memq://")
    assert "Traceback" not in result.stderr
    assert result.stdout
    assert result.returncode == 0 or command.startswith("doctor")
    assert run(umbrella, amd64.home, "--version").stdout == f"cmr {VERSION}\n"
    assert "which has no sim" in run(umbrella, amd64.home, "sim").stderr


def test_its_commands_find_their_modules_alone(amd64: Built) -> None:
    for name, function in package.COMMANDS.items():
        text = (amd64.tree / "usr" / "bin" / name).read_text()
        assert text.startswith("#!/usr/bin/python3 -IS\n")
        assert f'sys.path.insert(0, "/{package.HOME}")' in text
        assert f"from cmr.commands import {function}" in text


def test_two_builds_have_the_same_bytes(amd64: Built, tmp_path: Path) -> None:
    again = package.write_package(PROJECT, VERSION, "amd64", amd64.libraries, tmp_path, EPOCH)
    assert again.read_bytes() == amd64.path.read_bytes()


def test_its_unit_is_one_of_systemd_and_as_confined_as_that_of_cmr_init(amd64: Built, tmp_path: Path) -> None:
    unit = amd64.tree / "usr/lib/systemd/system/cmr-driver@.service"
    lines = set(unit.read_text().splitlines())
    of_init = contents(Answers(0, "roboclaw", "none", 0.04, 0.2), tmp_path)["cmr-driver-0.service"]
    assert {line for line in of_init.splitlines() if not line.startswith(("Description", "ExecStart"))} <= lines
    assert {"User=cmr", "NoNewPrivileges=yes", "ProtectSystem=strict", "Restart=on-failure", "LimitRTPRIO=1"} <= lines
    assert_systemd_takes(unit, tmp_path / "cmr-driver@0.service")


def assert_systemd_takes(unit: Path, copy: Path) -> None:
    if shutil.which("systemd-analyze"):
        copy.write_text(re.sub("/usr/bin/cmr-[a-z]+", "/bin/true", unit.read_text()))
        checked = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True, check=False)
        assert str(copy.parent) not in checked.stderr


def test_the_unit_of_its_agent_may_do_what_that_of_the_driver_may_and_no_more(amd64: Built, tmp_path: Path) -> None:
    units = amd64.tree / "usr/lib/systemd/system"

    def confinement(name: str) -> set[str]:
        own = ("Description", "ExecStart", "EnvironmentFile")
        return {line for line in (units / name).read_text().splitlines() if not line.startswith(own)}

    assert confinement("cmr-agent.service") == confinement("cmr-driver@.service")
    assert_systemd_takes(units / "cmr-agent.service", tmp_path / "cmr-agent.service")
    options = (amd64.tree / package.AGENT_CONFIGURATION).read_text()
    assert "ARGUMENTS=--out /var/lib/cmr/" in options, "the folder that it may write to"


def test_its_agent_refuses_what_is_not_installed(amd64: Built) -> None:
    program = "from cmr.processes.requests import PROGRAMS, is_there; print(*filter(is_there, PROGRAMS))"
    assert "cmr-run-recorder" not in run(program, amd64.home).stdout.split()


def test_its_ports_are_those_of_cmr_init(amd64: Built) -> None:
    rules = (amd64.tree / "usr/lib/udev/rules.d/60-cmr.rules").read_text()
    assert re.findall(r'idProduct\}=="(\w+)"', rules) == ["2404", "5740"]
    assert f"--port /dev/{package.PORT}" in (amd64.tree / package.ROBOT_CONFIGURATION).read_text()


def test_its_user_may_use_serial_ports(amd64: Built, tmp_path: Path) -> None:
    if shutil.which("systemd-sysusers") is None:
        pytest.skip("systemd-sysusers is not installed")
    description = amd64.tree / "usr/lib/sysusers.d/cmr-driver.conf"
    (tmp_path / "etc").mkdir()
    command = ["systemd-sysusers", f"--root={tmp_path}", str(shutil.copy(description, tmp_path))]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert re.search(r"^dialout:.*:cmr$", (tmp_path / "etc" / "group").read_text(), re.MULTILINE)


def test_its_scripts_are_ones_of_the_shell(amd64: Built, tmp_path: Path) -> None:
    subprocess.run(["dpkg-deb", "-e", str(amd64.path), str(tmp_path)], check=True)
    for name in ("postinst", "prerm", "postrm"):
        subprocess.run(["sh", "-n", str(tmp_path / name)], check=True)
    assert (tmp_path / "conffiles").read_text() == f"/{package.ROBOT_CONFIGURATION}\n/{package.AGENT_CONFIGURATION}\n"


def test_the_wheel_requires_three_libraries_and_installs_the_same_modules(amd64: Built, tmp_path: Path) -> None:
    made = wheel.write_wheel(PROJECT, VERSION, tmp_path, EPOCH)
    target = tmp_path / "installed"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", str(target)]
    subprocess.run([*command, str(made)], check=True, capture_output=True, timeout=120.0)
    [metadata] = target.glob("*.dist-info/METADATA")
    required = email.message_from_string(metadata.read_text()).get_all("Requires-Dist", [])
    assert [re.split("[<>=]", one)[0] for one in required] == ["lcm", "pyserial", "PyYAML"]

    def modules_in(folder: Path) -> set[str]:
        found = (path.relative_to(folder) for top in ("cmr", "robot_driver") for path in (folder / top).rglob("*.py"))
        return {path.as_posix() for path in found}

    assert modules_in(target) == modules_in(amd64.home)
    assert sorted(path.name for path in (target / "bin").iterdir()) == ["cmr", "cmr-agent", "cmr-driver"]
    declared = (PROJECT / "pyproject.toml").read_text()
    assert all(f'{name} = "{function}"' in declared for name, function in wheel.SCRIPTS.items())


def test_a_library_without_what_is_not_loaded_has_its_segments_alone() -> None:
    segments = [(0x1000, 0x200), (0x1800, 0x10)]
    header = bytearray(0x40)
    header[:4], header[0x12] = b"\x7fELF", 62
    header[0x20:0x28], header[0x28:0x30] = (0x40).to_bytes(8, "little"), (0x2000).to_bytes(8, "little")
    header[0x36], header[0x38], header[0x3C] = 0x38, len(segments), 9
    table = b"".join(
        bytes(8) + start.to_bytes(8, "little") + bytes(16) + size.to_bytes(8, "little") + bytes(16)
        for start, size in segments
    )
    library = (bytes(header) + table).ljust(0x3000, b"x")
    kept = shipping_libraries.strip_unloaded(library)
    assert len(kept) == 0x1810
    assert kept[0x28:0x30] == bytes(8)
    assert kept[0x3C:0x40] == bytes(4)
    assert kept[0x40:] == library[0x40:0x1810]
