"""A process stays on the newest parameters of a robot, whoever replaced them."""

import itertools
import os
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import now_utime
from cmr.msg import motor_command_t, parameters_t
from cmr.parameters.file import ParameterFile, announcement, sha256_of
from cmr.parameters.following import ParameterFollower
from tests.documents.test_bounds import MULTIPLYING
from tests.parameters.test_parameter_file import with_radius

PROMISED = 1.0  # s from the replacement of a file to its use


def announced(file: ParameterFile, sequence: int) -> Any:
    return announcement(file.robot_id, file.to_yaml(), sequence)


def radius_of(follower: ParameterFollower) -> float | None:
    return follower.parameters.value("wheel_radius") if follower.parameters else None


def take(follower: ParameterFollower, message: Any) -> bool:
    return follower.handle(message.utime, f"PARAMETERS_{message.robot_id}", message)


def poll_until(follower: ParameterFollower, happened: Callable[[], bool], patience: float = 10.0) -> float:
    """Poll until something has happened; return how long it took [s]."""
    began = time.monotonic()
    while not happened():
        assert time.monotonic() - began < patience
        follower.poll()
        time.sleep(0.01)
    return time.monotonic() - began


def poll_for_a_while(follower: ParameterFollower) -> list[bool]:
    """Poll long enough for the file to be looked at more than once; return what each look reported."""
    reported = []
    end = time.monotonic() + 0.6
    while time.monotonic() < end:
        reported.append(follower.poll())
        time.sleep(0.01)
    return reported


# Reading and writing


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A parameter file, a minute old."""
    path = tmp_path / "robot_0.yaml"
    with_radius(0.04).save(path)
    minute_ago = time.time() - 60.0
    os.utime(path, (minute_ago, minute_ago))
    return path


def test_the_file_at_the_start_is_in_use_at_once(path: Path) -> None:
    follower = ParameterFollower(0, path)
    assert radius_of(follower) == 0.04
    assert follower.sha256 == sha256_of(path.read_text())
    assert follower.message == ""


def test_a_replaced_file_is_in_use_within_a_second_and_reported_once(path: Path) -> None:
    follower = ParameterFollower(0, path)
    with_radius(0.05).save(path)
    assert poll_until(follower, lambda: radius_of(follower) == 0.05) < PROMISED
    with_radius(0.06).save(path)
    assert poll_for_a_while(follower).count(True) == 1
    assert radius_of(follower) == 0.06


def test_a_file_edited_in_place_is_in_use_within_a_second(path: Path) -> None:
    follower = ParameterFollower(0, path)
    path.write_text(path.read_text().replace("0.04", "0.05"))
    assert poll_until(follower, lambda: radius_of(follower) == 0.05) < PROMISED


def test_a_file_that_appears_later_is_in_use_within_a_second(path: Path) -> None:
    other = path.with_name("later.yaml")
    follower = ParameterFollower(0, other)
    assert follower.parameters is None
    assert str(other) in follower.message
    with_radius(0.07).save(other)
    assert poll_until(follower, lambda: radius_of(follower) == 0.07) < PROMISED
    assert follower.message == ""


def test_a_newer_announcement_is_in_use_at_once(path: Path) -> None:
    follower = ParameterFollower(0, path)
    assert take(follower, announced(with_radius(0.05), now_utime()))
    assert radius_of(follower) == 0.05
    assert not any(poll_for_a_while(follower))
    assert radius_of(follower) == 0.05


def test_an_announcement_without_any_file_is_enough() -> None:
    follower = ParameterFollower(3)
    assert follower.announcement() is None
    assert take(follower, announced(with_radius(0.05, robot_id=3), 1))
    assert radius_of(follower) == 0.05


def test_an_old_announcement_repeated_after_a_newer_file_is_ignored(path: Path) -> None:
    follower = ParameterFollower(0, path)
    old = announced(with_radius(0.05), now_utime())
    assert take(follower, old)
    with_radius(0.06).save(path)
    poll_until(follower, lambda: radius_of(follower) == 0.06)
    for _ in range(3):
        old.utime = now_utime()
        assert not take(follower, old)
        assert not any(poll_for_a_while(follower))
    assert radius_of(follower) == 0.06
    assert follower.message == ""


def test_an_announcement_older_than_the_file_at_the_start_is_ignored(path: Path) -> None:
    follower = ParameterFollower(0, path)
    assert not take(follower, announced(with_radius(0.05), now_utime() - 3600_000_000))
    assert radius_of(follower) == 0.04


def test_a_file_from_the_future_does_not_shut_out_announcements(path: Path) -> None:
    tomorrow = time.time() + 86_400.0
    os.utime(path, (tomorrow, tomorrow))
    follower = ParameterFollower(0, path)
    assert take(follower, announced(with_radius(0.05), now_utime() + 1))
    assert radius_of(follower) == 0.05


def test_the_same_content_again_is_no_change(path: Path) -> None:
    follower = ParameterFollower(0, path)
    path.write_text(path.read_text())
    assert not any(poll_for_a_while(follower))
    assert not take(follower, announcement(0, path.read_text(), now_utime()))
    assert not any(poll_for_a_while(follower))


def test_processes_that_announce_to_each_other_settle_on_one_version(path: Path) -> None:
    followers = [ParameterFollower(0, path), ParameterFollower(0), ParameterFollower(0, path)]
    with_radius(0.05).save(path)
    poll_until(followers[0], lambda: radius_of(followers[0]) == 0.05)
    poll_until(followers[2], lambda: radius_of(followers[2]) == 0.05)
    changes = []
    for _ in range(3):
        for sender, receiver in itertools.permutations(followers, 2):
            message = sender.announcement()
            changes.append(message is not None and take(receiver, parameters_t.decode(message.encode())))
    assert changes.count(True) == 1  # the one without a file learned it
    assert {follower.sha256 for follower in followers} == {sha256_of(path.read_text())}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "not a YAML mapping"),
        (b"\xff\xfe\x00binary", "cannot be read"),
        (with_radius(0.05).to_yaml()[:60].encode(), "must be a mapping|cannot be read|written"),
        (with_radius(0.05, robot_id=1).to_yaml().encode(), "is of robot 1, not 0"),
        (b"[" * 3_000, "cannot be read"),
    ],
    ids=["empty", "binary", "half", "foreign robot", "nested"],
)
def test_a_broken_or_foreign_file_changes_nothing_is_told_and_can_be_repaired(
    content: bytes, why: str, path: Path
) -> None:
    follower = ParameterFollower(0, path)
    sha256 = follower.sha256
    path.write_bytes(content)
    assert not any(poll_for_a_while(follower))
    assert (radius_of(follower), follower.sha256) == (0.04, sha256)
    assert re.search(why, follower.message)
    assert str(path) in follower.message
    assert follower.message.endswith("Parameters in use were kept.")
    with_radius(0.05).save(path)
    assert poll_until(follower, lambda: radius_of(follower) == 0.05) < PROMISED
    assert follower.message == ""


def test_the_fault_of_a_file_is_told_as_long_as_it_lasts(path: Path) -> None:
    follower = ParameterFollower(0, path)
    path.write_text("broken")
    poll_for_a_while(follower)
    assert take(follower, announced(with_radius(0.05), now_utime()))
    assert radius_of(follower) == 0.05
    assert "not a YAML mapping" in follower.message


def test_a_file_that_is_away_for_a_moment_does_not_win_over_a_newer_announcement(path: Path) -> None:
    follower = ParameterFollower(0, path)
    assert take(follower, announced(with_radius(0.05), now_utime()))
    path.rename(path.with_suffix(".away"))
    poll_until(follower, lambda: "There is no " in follower.message)
    path.with_suffix(".away").rename(path)
    poll_until(follower, lambda: follower.message == "")
    assert radius_of(follower) == 0.05


def test_an_announcement_with_the_wrong_sha256_changes_nothing_and_is_told_until_a_sound_one_comes(path: Path) -> None:
    follower = ParameterFollower(0, path)
    wrong = announced(with_radius(0.05), now_utime())
    wrong.yaml = wrong.yaml.replace("0.05", "0.09")
    assert not take(follower, wrong)
    assert radius_of(follower) == 0.04
    assert follower.message.startswith("PARAMETERS_0: the announced sha256 does not fit")
    own = follower.announcement()
    assert not take(follower, own)
    assert follower.message == ""


@pytest.mark.parametrize("text", ["", "broken", with_radius(0.05, robot_id=1).to_yaml()])
def test_a_broken_announcement_changes_nothing_and_is_told(text: str, path: Path) -> None:
    follower = ParameterFollower(0, path)
    assert not take(follower, announcement(0, text, now_utime()))
    assert radius_of(follower) == 0.04
    assert follower.message.startswith("PARAMETERS_0: ")
    assert take(follower, announced(with_radius(0.05), now_utime()))
    assert follower.message == ""


def test_announcements_of_other_robots_and_other_messages_are_passed_over(path: Path) -> None:
    follower = ParameterFollower(0, path)
    assert not take(follower, announced(with_radius(0.05, robot_id=1), now_utime()))
    assert not follower.handle(now_utime(), "MOTOR_COMMAND_0", motor_command_t())
    assert (radius_of(follower), follower.message) == (0.04, "")


LAST = 2**63 - 1  # of what a version can say


def test_an_announcement_of_the_last_possible_version_does_not_shut_out_what_follows(path: Path) -> None:
    follower = ParameterFollower(0, path)
    last = announced(with_radius(0.05), LAST)
    assert take(follower, last)
    assert follower.sequence <= now_utime()
    assert take(follower, announced(with_radius(0.06), now_utime()))
    assert not take(follower, last)  # it is repeated, and older than what came after it
    assert radius_of(follower) == 0.06
    with_radius(0.07).save(path)
    poll_until(follower, lambda: radius_of(follower) == 0.07)
    own = follower.announcement()
    assert own is not None
    assert own.sequence <= now_utime()


def test_what_is_wrong_with_a_hostile_announcement_is_said_in_a_short_sentence(path: Path) -> None:
    follower = ParameterFollower(0, path)
    began = time.process_time()
    assert not take(follower, announcement(0, f"schema: {{{'x' * 100_000}: 1}}\n{MULTIPLYING}", now_utime()))
    assert not take(follower, announcement(0, f"schema: 1\n{'x' * 100_000}: [1]", now_utime()))
    assert time.process_time() - began < 1.0
    assert len(follower.message) < 300


def test_announcements_that_cost_much_to_refuse_are_not_all_read(path: Path) -> None:
    follower = ParameterFollower(0, path)
    values = "schema: 1\nprovenance: [" + "[], " * 60_000
    began, read = time.process_time(), 0
    end = time.monotonic() + 2.0
    while time.monotonic() < end:
        take(follower, announcement(0, f"{values}{read}", now_utime()))
        read += 1
        time.sleep(0.005)
    assert time.process_time() - began < 1.0
    wait = time.monotonic() + 1.5
    while not take(follower, announced(with_radius(0.05), now_utime())):
        assert time.monotonic() < wait
        time.sleep(0.05)


def test_a_pipe_in_place_of_the_file_is_reported_and_waited_for_by_nobody(path: Path) -> None:
    follower = ParameterFollower(0, path)
    path.unlink()
    os.mkfifo(path)
    poll_until(follower, lambda: "it is no regular file" in follower.message, patience=2.0)
    assert radius_of(follower) == 0.04
