"""ROS 2 stays on this computer unless the command line says otherwise, in the words of the version at hand."""

import os

import pytest

from robot_driver.ros2.network import choose_network

NAMES = ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY")


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "environ", {"ROS_DOMAIN_ID": "5", "ROS_LOCALHOST_ONLY": "0"})


def chosen() -> tuple[str | None, ...]:
    return tuple(os.environ.get(name) for name in NAMES)


def test_the_usual_range_is_this_computer_and_the_domain_is_left_as_it_is() -> None:
    choose_network(None, "localhost")
    assert chosen() == ("5", "LOCALHOST", None)


def test_the_network_is_looked_at_where_that_is_asked_for() -> None:
    choose_network(7, "subnet")
    assert chosen() == ("7", "SUBNET", None)


@pytest.mark.parametrize(("reach", "said"), [("localhost", "1"), ("off", "1"), ("subnet", "0")])
def test_an_older_ros_is_told_in_its_own_words(reach: str, said: str) -> None:
    os.environ["ROS_DISTRO"] = "humble"
    choose_network(None, reach)
    assert chosen() == ("5", None, said)
