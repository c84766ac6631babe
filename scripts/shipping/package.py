"""The Debian package of the driver alone, with its libraries; it depends on Python, GLib and systemd only."""

import os
import subprocess
import tempfile
from pathlib import Path
from textwrap import dedent

from documentation.imports import PROJECT

from cmr.cli.system_files import USB_IDS, agent_unit, driver_unit, udev_rule
from shipping.contents import driver_files
from shipping.libraries import PYTHONS
from shipping.wheel import SUMMARY, metadata_files

NAME = "cmr-driver"
HOME = f"usr/lib/{NAME}"
EXECUTABLE, PLAIN, FOLDER = 0o755, 0o644, 0o755
AGENT = "cmr-agent"
COMMANDS = {"cmr": "umbrella", "cmr-driver": "driver", AGENT: "agent"}  # their functions in cmr.commands
ROBOT_CONFIGURATION, AGENT_CONFIGURATION = "etc/cmr/robot-0.conf", "etc/cmr/agent.conf"
PORT = "cmr-motor"
FIRST, LAST = (tuple(map(int, python.split("."))) for python in (PYTHONS[0], PYTHONS[-1]))

COMMAND = """\
#!/usr/bin/python3 -IS
import sys

sys.path.insert(0, "/{home}")
from cmr.commands import {function}

sys.exit({function}())
"""
ROBOT = f"""\
# Options of cmr-driver for robot 0; cmr-driver --help lists them. For robot 3, copy this to robot-3.conf.
# After a change, run: sudo systemctl restart cmr-driver@0
ARGUMENTS=--controller roboclaw --port /dev/{PORT}
"""
AGENT_OPTIONS = f"""\
# Options of cmr-agent; cmr-agent --help lists them. It serves experiments that cmr-run leads on another computer, and
# needs the key of the bus. If it is to drive a robot, disable the robot's own service:
# sudo systemctl disable cmr-driver@0
# Then start the agent: sudo systemctl enable --now {AGENT}
ARGUMENTS=--out /var/lib/cmr/agent
"""
UNIT = (
    "User=cmr",
    "Group=cmr",
    "SupplementaryGroups=dialout",
    "Environment=XDG_CONFIG_HOME=/etc",  # for /etc/cmr/key and /etc/cmr/config.yaml, if they exist
    "CapabilityBoundingSet=",
)
USER = """\
u cmr - "Driver of robots" /var/lib/cmr
m cmr dialout
"""
AFTER_UNPACKING = f"""\
#!/bin/sh
set -e
[ "$1" = configure ] || exit 0
systemd-sysusers {NAME}.conf
/usr/bin/python3 -IS -m compileall -q /{HOME} || echo "{NAME}: not precompiled, so it starts more slowly"
if [ -d /run/systemd/system ]; then
    systemctl daemon-reload
    [ -z "$2" ] || echo "{NAME}: still running the old version; restart it: systemctl restart 'cmr-driver@*' {AGENT}"
fi
if [ -d /run/udev ]; then
    udevadm control --reload
    udevadm trigger --subsystem-match=tty
fi
"""
BEFORE_REMOVAL = f"""\
#!/bin/sh
set -e
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
    systemctl stop {AGENT}.service 'cmr-driver@*.service'
fi
find /{HOME} -name __pycache__ -prune -exec rm -rf {{}} +
"""
AFTER_REMOVAL = f"""\
#!/bin/sh
set -e
if [ "$1" = purge ]; then
    rm -rf /var/lib/cmr
    rm -f /etc/systemd/system/multi-user.target.wants/cmr-driver@*.service
    rm -f /etc/systemd/system/multi-user.target.wants/{AGENT}.service
fi
if [ -d /run/systemd/system ]; then
    systemctl daemon-reload
fi
"""


def files_of_package(root: Path, version: str, libraries: dict[str, bytes]) -> dict[str, tuple[bytes, int]]:
    """Return content and mode of all files, by path; `root` is an import root with all of CMR."""
    modules = {path: (root / path).read_bytes() for path in driver_files(root)}
    private = modules | libraries | metadata_files(version, f"calibrated_mixed_reality_driver-{version}.dist-info")
    rules = dict.fromkeys(udev_rule(PORT, ids) for ids in USB_IDS.values())
    system = {
        f"usr/lib/systemd/system/{NAME}@.service": _driver_unit(),
        f"usr/lib/systemd/system/{AGENT}.service": _agent_unit(),
        "usr/lib/udev/rules.d/60-cmr.rules": "\n".join([*rules, ""]),
        f"usr/lib/sysusers.d/{NAME}.conf": USER,
        ROBOT_CONFIGURATION: ROBOT,
        AGENT_CONFIGURATION: AGENT_OPTIONS,
        f"usr/share/doc/{NAME}/copyright": _copyright(),
    }
    return {
        **{f"{HOME}/{path}": (content, PLAIN) for path, content in private.items()},
        **{path: (text.encode(), PLAIN) for path, text in system.items()},
        **{
            f"usr/bin/{name}": (COMMAND.format(home=HOME, function=function).encode(), EXECUTABLE)
            for name, function in COMMANDS.items()
        },
    }


def control_files(version: str, architecture: str, installed: int) -> dict[str, tuple[bytes, int]]:
    """Return content and mode of the package manager's files, by name; `installed` is the size of all files [bytes]."""
    return {
        "control": (_control(version, architecture, installed).encode(), PLAIN),
        "conffiles": (f"/{ROBOT_CONFIGURATION}\n/{AGENT_CONFIGURATION}\n".encode(), PLAIN),
        "postinst": (AFTER_UNPACKING.encode(), EXECUTABLE),
        "prerm": (BEFORE_REMOVAL.encode(), EXECUTABLE),
        "postrm": (AFTER_REMOVAL.encode(), EXECUTABLE),
    }


def write_package(
    root: Path, version: str, architecture: str, libraries: dict[str, bytes], folder: Path, epoch: int
) -> Path:
    """Write the package into a folder with dpkg-deb; return its path.

    All files have the time `epoch`, so the package is reproducible. Raises SystemExit with the messages of dpkg-deb if
    it fails.
    """
    files = files_of_package(root, version, libraries)
    control = control_files(version, architecture, sum(len(content) for content, _mode in files.values()))
    package = folder / f"{NAME}_{version}_{architecture}.deb"
    with tempfile.TemporaryDirectory() as name:
        tree = Path(name)
        for path, (content, mode) in {**files, **{f"DEBIAN/{one}": what for one, what in control.items()}}.items():
            _write(tree / path, content, mode)
        for entry in (tree, *tree.rglob("*")):
            if entry.is_dir():
                entry.chmod(FOLDER)
            os.utime(entry, (epoch, epoch))
        command = ["dpkg-deb", "--root-owner-group", "-Zxz", "--build", str(tree), str(package)]
        environment = {**os.environ, "SOURCE_DATE_EPOCH": str(epoch), "DPKG_DEB_THREADS_MAX": "1"}
        result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if result.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{result.stdout}{result.stderr}")
    return package


def _driver_unit() -> str:
    options = "EnvironmentFile=/etc/cmr/robot-%i.conf"
    return driver_unit("%i", f"/usr/bin/{NAME} --robot %i $ARGUMENTS", options, *UNIT)


def _agent_unit() -> str:
    return agent_unit(f"/usr/bin/{AGENT} $ARGUMENTS", f"EnvironmentFile=/{AGENT_CONFIGURATION}", *UNIT)


def _write(path: Path, content: bytes, mode: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    path.chmod(mode)


def _control(version: str, architecture: str, installed: int) -> str:
    return dedent(f"""\
        Package: {NAME}
        Version: {version}
        Architecture: {architecture}
        Maintainer: the CMR authors
        Installed-Size: {-(-installed // 1024)}
        Depends: python3 (>= {FIRST[0]}.{FIRST[1]}), python3 (<< {LAST[0]}.{LAST[1] + 1}), libc6 (>= 2.28), libglib2.0-0 | libglib2.0-0t64, systemd | systemd-standalone-sysusers
        Section: misc
        Priority: optional
        Description: {SUMMARY}
         It connects a motor controller and a gyro to the bus: cmr-driver@0 is the
         service of robot 0, configured in /etc/cmr/robot-0.conf; {AGENT} runs
         drivers for experiments that another computer leads. The installation starts
         no service.
        """)  # noqa: E501 - a field is one line


def _copyright() -> str:
    licence = (PROJECT / "LICENSE").read_text(encoding="utf-8")
    return f"{licence}\nlcm, pyserial and PyYAML have licences of their own: /{HOME}/*.dist-info\n"
