"""What a user sets once for all commands: bus, key, robot and folders. Command line and environment come before it.

The file is `$XDG_CONFIG_HOME/cmr/config.yaml`, usually `~/.config/cmr/config.yaml`.
"""

import os
from pathlib import Path

from cmr.cli.errors import ExpectedError

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304"  # of LCM; stays on this host
LARGEST_ROBOT_ID = 2**31 - 1  # what the int32 of the messages holds
# Each setting with the environment variable that comes before it.
SETTINGS = {
    "lcm_url": "LCM_DEFAULT_URL",  # LCM's own name for it
    "robot": "CMR_ROBOT",
    "parameters": "CMR_PARAMETERS",
    "results": "CMR_RESULTS",
    "key": "CMR_KEY",
}
INSECURE = "CMR_INSECURE"  # in the environment, of a process that was started with --insecure and of its own


class ConfigurationError(ExpectedError):
    """The configuration cannot be used; the text says where, what is wrong and what is allowed."""


def path() -> Path:
    """Return where the configuration file is, or would be."""
    base = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "cmr" / "config.yaml"


def lcm_url() -> str | None:
    """Return the LCM URL of the environment, otherwise of the file; None where neither has one."""
    return _setting("lcm_url")


def robot() -> int:
    """Return the robot that commands are about if none is named: 0 where nothing is set.

    Raises ConfigurationError for what is no robot id.
    """
    text = _setting("robot") or "0"
    if not (text.isascii() and text.isdecimal()):
        raise ConfigurationError(f"{_place('robot')}: a robot id is a whole number of 0 or more, not {text!r}.")
    return int(text)


def parameters() -> Path:
    """Return the folder of the files robot_N.yaml; the current one where nothing is set."""
    return Path(_setting("parameters") or ".").expanduser()


def parameter_file(robot_id: int) -> Path:
    """Return where the parameter file of a robot is, or would be."""
    return parameters() / f"robot_{robot_id}.yaml"


def results() -> Path:
    """Return the folder in which results get a folder of their own; the current one where nothing is set."""
    return Path(_setting("results") or ".").expanduser()


def key_file() -> tuple[Path, bool]:
    """Return where the key of the bus is, or would be, and whether somebody said so."""
    named = _setting("key")
    return (Path(named).expanduser(), True) if named else (path().parent / "key", False)


def is_insecure() -> bool:
    """Return whether messages that nobody signed are taken."""
    return os.environ.get(INSECURE, "") not in ("", "0")


def be_insecure() -> None:
    """Take messages that nobody signed from now on; processes that this one starts do so, too."""
    os.environ[INSECURE] = "1"


def _place(name: str) -> str:
    variable = SETTINGS[name]
    return f"{variable} in the environment" if os.environ.get(variable) else f"{path()}: {name}"


def _setting(name: str) -> str | None:
    return os.environ.get(SETTINGS[name]) or _file().get(name)


def _file() -> dict[str, str]:
    """Return the settings of the file, as texts; none where there is no file."""
    try:
        path().stat()
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except OSError as error:
        raise ConfigurationError(f"{path()}: cannot be read: {error.strerror}") from error
    # YAML takes a while, and most have no file.
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
