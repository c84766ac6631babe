"""The command line of cmr-ros2 refuses what must not be driven, before any ROS 2 is needed."""

from pathlib import Path

import pytest

from cmr.cli.errors import CommandError
from robot_driver.ros2.command import main
from robot_driver.ros2.profile import shipped

EXAMPLE = shipped()["example"].read_text(encoding="utf-8")


def test_a_robot_that_does_not_stop_by_itself_is_refused_with_the_reason() -> None:
    with pytest.raises(CommandError) as refused:
        main(["--robot", "0=turtlebot3"])
    assert "has no command timeout of its own" in str(refused.value)
    assert "HEARTBEAT_TIMEOUT_MS" in str(refused.value)
    assert "--no-base-timeout" in str(refused.value)


def test_a_profile_in_which_nobody_has_filled_in_the_timeout_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(EXAMPLE.replace("  command_timeout: 0.5         # s\n", ""))
    with pytest.raises(CommandError, match="no command timeout of its own"):
        main(["--robot", f"0={path}@/mine"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "Nothing to do"),
        (["--robot", "0=nowhere"], "There is no profile nowhere"),
        (["--robot", "0=example", "--robot", "0=jackal"], "Robot 0 is named twice"),
        (["--robot", "0=example", "--virtual", "0"], "Robot 0 is named twice"),
        (["--virtual", "10,11", "--show", "11"], "Robot 11 is named twice"),
    ],
)
def test_what_cannot_be_meant_is_refused(arguments: list[str], said: str) -> None:
    with pytest.raises(CommandError, match=said):
        main(arguments)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--robot", "turtlebot3"],
        ["--robot", "0=turtlebot3@tb3"],
        ["--robot", "-1=turtlebot3"],
        ["--virtual", "10;11"],
        ["--domain-id", "233"],
        ["--range", "world"],
    ],
)
def test_wrong_usage_ends_with_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2


def test_profiles_are_listed_with_what_stops_their_robots(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--profiles"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert "no command timeout" in lines["turtlebot3"]
    assert "command timeout 0.5 s" in lines["jackal"]
    assert all("never tried on a real robot" in line for line in lines.values())
