"""Profiles of ROS 2 robots: those that CMR ships are complete, and what cannot be is refused by line and key."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_driver.ros2.profile import Profile, ProfileError, shipped

SHIPPED = ("turtlebot3", "turtlebot4", "jackal", "husky", "create3", "example")
EXAMPLE = shipped()["example"].read_text(encoding="utf-8")


def test_the_robots_that_are_promised_are_there() -> None:
    assert set(shipped()) == set(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_profile_names_its_sources_and_whether_it_was_tried(name: str) -> None:
    profile = Profile.load(name)
    assert profile.sources
    assert profile.base.source
    assert "tried:" in shipped()[name].read_text(encoding="utf-8")
    assert profile.tried == ""  # nobody has told of one yet


@pytest.mark.parametrize("name", SHIPPED)
def test_the_largest_command_of_a_shipped_profile_is_within_the_wheels_reach(name: str) -> None:
    profile = Profile.load(name)
    rim = profile.command.speed + 0.5 * profile.counted_width * profile.command.turn_rate
    assert rim / profile.nominal.wheel_radius <= 2.5 * profile.nominal.top_wheel_speed
    assert profile.command.speed / profile.nominal.wheel_radius <= profile.nominal.top_wheel_speed


def test_a_turtlebot3_has_no_timeout_of_its_own() -> None:
    assert Profile.load("turtlebot3").base.command_timeout is None


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("schema: 1", "schema: 2", "line 3: schema is not 1"),
        ("topic: cmd_vel ", "topic: cmd vel ", "'cmd vel' is no name of a topic"),
        ("geometry_msgs/msg/Twist ", "geometry_msgs/msg/Wrench ", "command.type must be one of"),
        ("speed: 0.74", "speed: 0", "command.speed must be a number from 0.01 to 20"),
        ("slowing_down: 20.0", "slowing_down: 5.0", "slowing down at least as fast as speeding up"),
        ("left: wheel_left_joint", "left: ' '", "wheels.left"),
        ("sign: 1  ", "sign: 0  ", "the sign must be 1 or -1"),
        ("  topic: pose\n", "  topic: pose\n  frames: map, base_link\n", "either a topic or frames"),
        ("wheel_radius: 0.04", "wheel_radius: -1", "nominal.wheel_radius must be a number"),
        ("command_timeout: 0.5", "comand_timeout: 0.5", "base.comand_timeout is not known here"),
        ("name: emulated robot", "nickname: robot", "nickname is not known here"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(before: str, after: str, said: str) -> None:
    assert before in EXAMPLE
    with pytest.raises(ProfileError) as refused:
        Profile.parse(EXAMPLE.replace(before, after))
    assert said in str(refused.value)


def test_a_profile_that_is_not_there_names_those_that_are() -> None:
    with pytest.raises(ProfileError, match="shipped are create3, example"):
        Profile.load("nowhere.yaml")


@given(st.text(max_size=300))
def test_any_text_is_a_profile_or_refused(text: str) -> None:
    for profile in (text, EXAMPLE + text, EXAMPLE.replace("cmd_vel", text)):
        with suppress(ProfileError):
            Profile.parse(profile)


@given(st.integers(0, len(EXAMPLE)), st.integers(0, 200))
def test_a_profile_with_a_piece_missing_is_one_or_refused(at: int, length: int) -> None:
    with suppress(ProfileError):
        Profile.parse(EXAMPLE[:at] + EXAMPLE[at + length :])
