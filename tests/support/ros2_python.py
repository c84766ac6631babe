"""The Python that has rclpy: this one, or that of the environment which scripts/install_ros2 makes."""

import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.support.project import PROJECT

WHY = "rclpy is not installed: scripts/install_ros2 makes an environment with it, or source a ROS 2"


def ros2_python() -> str:
    """Return the path of the Python with rclpy; skip the test where there is none."""
    if find_spec("rclpy") is not None:
        return sys.executable
    own = PROJECT / ".venv" / "ros2" / "bin" / "python"
    if not own.exists():
        pytest.skip(WHY)
    return str(own)


def free_domain() -> int:
    """Return a ROS domain for this test alone: of those whose ports are below the ephemeral ones on Linux."""
    return 10 + os.getpid() % 90


def environment(url: str, folder: Path) -> dict[str, str]:
    """Return the environment of a process on a bus of the test's own, which keeps its files in a folder."""
    path = os.pathsep.join(filter(None, (str(PROJECT), os.environ.get("PYTHONPATH", ""))))
    return {**os.environ, "LCM_DEFAULT_URL": url, "PYTHONPATH": path, "XDG_STATE_HOME": str(folder)}
