"""A user's settings for all commands: bus, key, robot and folders. Command line and environment take precedence.

The file is `$XDG_CONFIG_HOME/cmr/config.yaml`, usually `~/.config/cmr/config.yaml`.
"""

import os
from pathlib import Path

from cmr.cli.errors import ExpectedError

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304"  # of LCM; stays on this host
LARGEST_ROBOT_ID = 2**31 - 1  # what the int32 of the messages holds
# Each setting with the environment variable that takes precedence.
SETTINGS = {
    "lcm_url": "LCM_DEFAULT_URL",  # LCM's own name for it
    "robot": "CMR_ROBOT",
    "parameters": "CMR_PARAMETERS",
    "results": "CMR_RESULTS",
    "key": "CMR_KEY",
}
INSECURE = "CMR_INSECURE"  # set in the environment of a process started with --insecure, and its children


class ConfigurationError(ExpectedError):
    """The configuration cannot be used; the text says where, what is wrong and what is allowed."""


def path() -> Path:
    """Return the path of the configuration file, which may not exist."""
    base = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "cmr" / "config.yaml"


def lcm_url() -> str | None:
    """Return the LCM URL from the environment, otherwise from the file; None if neither has one."""
    return _setting("lcm_url")


def robot() -> int:
    """Return the default robot for commands: 0 unless configured.

    Raises ConfigurationError for an invalid robot id.
    """
    text = _setting("robot") or "0"
    if not (text.isascii() and text.isdecimal()):
        raise ConfigurationError(f"{_place('robot')}: a robot id is a whole number of 0 or more, not {text!r}.")
    return int(text)


def parameters() -> Path:
    """Return the folder of the files robot_N.yaml; by default the current one."""
    return Path(_setting("parameters") or ".").expanduser()


def parameter_file(robot_id: int) -> Path:
    """Return the path of a robot's parameter file, which may not exist."""
    return parameters() / f"robot_{robot_id}.yaml"


def results() -> Path:
    """Return the folder in which results get subfolders; by default the current one."""
    return Path(_setting("results") or ".").expanduser()


def key_file() -> tuple[Path, bool]:
    """Return the path of the bus key, which may not exist, and whether it was configured."""
    named = _setting("key")
    return (Path(named).expanduser(), True) if named else (path().parent / "key", False)


def is_insecure() -> bool:
    """Return whether unsigned messages are accepted."""
    return os.environ.get(INSECURE, "") not in ("", "0")


def be_insecure() -> None:
    """Accept unsigned messages from now on, also in child processes."""
    os.environ[INSECURE] = "1"


def _place(name: str) -> str:
    variable = SETTINGS[name]
    return f"{variable} in the environment" if os.environ.get(variable) else f"{path()}: {name}"


def _setting(name: str) -> str | None:
    return os.environ.get(SETTINGS[name]) or _file().get(name)


def _file() -> dict[str, str]:
    """Return the settings of the file, as text; empty without a file."""
    try:
        path().stat()
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except OSError as error:
        raise ConfigurationError(f"{path()}: cannot be read: {error.strerror}") from error
    # Importing YAML is slow, and most users have no file.
    from cmr.documents.document import DocumentError, read_file

    try:
        document = read_file(path(), DocumentError, may_be_empty=True)
        if not document.is_mapping:
            raise document.place.error(f"has no settings; allowed are {', '.join(SETTINGS)}.")
        entries = dict(document.entries())
        unknown = sorted(entries.keys() - SETTINGS)
        if unknown:
            place = entries[unknown[0]].place._replace(key="")
            raise place.error(f"has {', '.join(unknown)}; allowed are {', '.join(SETTINGS)}.")
        return {name: str(item.value) for name, item in entries.items() if not item.is_absent}
    except DocumentError as error:
        raise ConfigurationError(str(error)) from error
