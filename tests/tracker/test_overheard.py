"""Poses of other programs are heard on a real bus, one's own are not, and nothing that strangers send does harm."""

import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.bus.bus import Bus
from cmr.bus.keys import write_new_key
from cmr.bus.messages import make
from cmr.bus.streams import GYRO, POSE
from cmr.msg import gyro_t, pose_xyt_t
from cmr.tracker import overheard
from cmr.tracker.overheard import MAGIC, MOST, Overheard, split
from tests.support.private_bus import private_url
from tests.support.taken import open_files, threads

pytestmark = pytest.mark.waits
WAY = 0.05  # s on the loopback


def send(bus: Bus, *robot_ids: int) -> None:
    """Publish a pose of each robot."""
    for robot_id in robot_ids:
        bus.publish(POSE, make(pose_xyt_t, utime=100, robot_id=robot_id, x=0.0, y=0.0, theta=0.0), robot_id)
    time.sleep(WAY)


@pytest.mark.parametrize("has_filters", [True, False])
def test_poses_of_another_program_are_heard_and_ones_own_are_not(
    has_filters: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not has_filters:
        monkeypatch.setattr(overheard, "SO_ATTACH_FILTER", 9999)  # which no kernel knows
    url = private_url()
    own, other = Bus(url), Bus(url)
    heard = Overheard(own)
    send(own, 1, 2)
    assert heard.robots() == set()
    send(other, 2, 3)
    other.publish(GYRO, make(gyro_t, utime=1, robot_id=4, yaw_rate=0.0, valid=True, received_utime=1), 4)
    send(own, 1)
    assert heard.robots() == {2, 3}
    assert heard.robots() == set()
    heard.close()


def test_ones_own_poses_do_not_even_reach_the_socket() -> None:
    url = private_url()
    own, other = Bus(url), Bus(url)
    heard = Overheard(own)
    send(own, *[1] * (2 * MOST))
    send(other, 2)
    assert heard.robots() == {2}  # of at most MOST packets, the other program's is the first
    heard.close()


def test_where_the_bus_has_a_key_unsigned_poses_do_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    url = private_url()
    stranger = Bus(url)
    write_new_key(tmp_path / "key")
    monkeypatch.setenv("CMR_KEY", str(tmp_path / "key"))
    own, other = Bus(url), Bus(url)
    heard = Overheard(own)
    send(stranger, 1)
    send(other, 2)
    assert heard.robots() == {2}
    heard.close()


@given(st.binary(max_size=80), st.booleans())
def test_whatever_comes_is_a_message_or_none(data: bytes, is_short: bool) -> None:
    message = split(MAGIC + bytes(4) + data if is_short else data)
    if is_short and b"\0" in data:
        assert message is not None
        assert message[1] == data.partition(b"\0")[2]
    elif is_short:
        assert message is None


def test_packets_that_are_no_messages_are_passed_over() -> None:
    url = private_url()
    own, other = Bus(url), Bus(url)
    heard = Overheard(own)
    for data in (b"", bytes(7), POSE.message_type().encode()[:-1], bytes(1000)):
        other._lcm.publish("POSE_1", data)
        other._lcm.publish("POSE_of_nobody", data)
    send(other, 5)
    assert heard.robots() == {5}
    heard.close()


def test_on_a_bus_without_multicast_it_hears_nobody() -> None:
    own = Bus("memq://of_a_test")
    heard = Overheard(own)
    assert heard.robots() == set()
    heard.close()


def test_it_leaves_nothing_behind() -> None:
    url = private_url()
    own = Bus(url)
    before = open_files(), threads()
    for _ in range(3):
        Overheard(own).close()
    assert (open_files(), threads()) == before
