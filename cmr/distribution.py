"""Describe this installation of CMR: its distribution, its version, and how to add an extra."""

import shutil
import sys
import zlib
from contextlib import suppress
from pathlib import Path

NAME = "calibrated-mixed-reality"  # its name on the package index, where "cmr" is taken
DRIVER_NAME = f"{NAME}-driver"  # only the driver and the modules it needs, for a robot's own computer
UNKNOWN_VERSION = "0+unknown"
ROOT = Path(__file__).resolve().parents[1]
FINGERPRINT = "lcmtypes.crc32"  # beside the message classes: which files they were generated from


def version() -> str:
    """Return the version of the installed distribution; UNKNOWN_VERSION where none is installed."""
    return next(iter(installed().values()), UNKNOWN_VERSION)


def installed() -> dict[str, str]:
    """Return the distributions of CMR that are installed, with their versions; normally one, since they contain the
    same modules.
    """
    # This import takes as long as most commands need to start
    from importlib.metadata import PackageNotFoundError, version

    found = {}
    for name in (NAME, DRIVER_NAME):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def fingerprint(message_types: Path) -> str:
    """Return a name for the contents of the .lcm files in a folder."""
    return f"{zlib.crc32(b''.join(file.read_bytes() for file in sorted(message_types.glob('*.lcm')))):08x}"


def outdated_messages(root: Path = ROOT) -> bool:
    """Return whether the .lcm files in a checkout have changed since its message classes were generated.

    `root` is the folder that holds the package `cmr`. An installation that is no checkout is never outdated.
    """
    message_types, written = root / "lcmtypes", root / "cmr" / "msg" / FINGERPRINT
    if not ((root / "pyproject.toml").is_file() and message_types.is_dir() and written.parent.is_dir()):
        return False
    return not written.is_file() or written.read_text(encoding="ascii") != fingerprint(message_types)


def has_module(name: str) -> bool:
    """Return whether this installation contains a CMR module; the driver's distribution contains only a few."""
    from importlib.util import find_spec

    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # not even the package that holds it
        return False


def how_to_install(extra: str) -> str:
    """Return the command that adds an extra to this installation: from its checkout, as CMR is not published."""
    if (ROOT / "pyproject.toml").is_file():
        return f"{_pip()} install -e '{ROOT}[{extra}]'"
    return f"{_pip()} install '.[{extra}]' in the folder of CMR's sources"


def how_to_install_again() -> str:
    """Return the command that installs this checkout once more."""
    return f"{_pip()} install -e '{ROOT}'"


def _pip() -> str:
    """Return the command that runs this interpreter's pip."""
    found = shutil.which("pip")
    beside = Path(sys.executable).parent
    return "pip" if found and Path(found).parent == beside else f"{sys.executable} -m pip"
