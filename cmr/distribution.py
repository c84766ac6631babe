"""Describe this installation of CMR: its distribution, its version, and how to add an extra."""

import shutil
import sys
from contextlib import suppress
from pathlib import Path

NAME = "calibrated-mixed-reality"  # its name on the package index, where "cmr" is taken
DRIVER_NAME = f"{NAME}-driver"  # only the driver and the modules it needs, for a robot's own computer
UNKNOWN_VERSION = "0+unknown"


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


def has_module(name: str) -> bool:
    """Return whether this installation contains a CMR module; the driver's distribution contains only a few."""
    from importlib.util import find_spec

    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # not even the package that holds it
        return False


def how_to_install(extra: str) -> str:
    """Return the command that adds an extra to this installation: from its checkout, as CMR is not published."""
    checkout = Path(__file__).resolve().parents[1]
    if (checkout / "pyproject.toml").is_file():
        return f"{_pip()} install -e '{checkout}[{extra}]'"
    return f"{_pip()} install '.[{extra}]' in the folder of CMR's sources"


def _pip() -> str:
    """Return the command that runs this interpreter's pip."""
    found = shutil.which("pip")
    beside = Path(sys.executable).parent
    return "pip" if found and Path(found).parent == beside else f"{sys.executable} -m pip"
