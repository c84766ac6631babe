"""Worlds of any size arrive whole: LCM splits what is larger than a packet, and puts it together again."""

import time

import numpy as np
import pytest

from cmr.bus.bus import Bus
from cmr.bus.streams import WORLD_STATE
from cmr.model.motion import RobotState
from cmr.world.view import VIRTUAL, Robots, WorldView, world_messages
from tests.support.bus_bench import receive_until
from tests.support.typed_messages import all_of

pytestmark = pytest.mark.real_time

EPOCH = 1_700_000_000_000_000  # us
PERIOD = 0.01  # s


@pytest.mark.parametrize(("count", "messages"), [(1_000, 30), (20_000, 10)])
def test_every_message_of_a_large_world_arrives_whole_at_100_hz(url: str, count: int, messages: int) -> None:
    sender, receiver = Bus(url), Bus(url)
    receiver.subscribe(WORLD_STATE, every=True)
    columns = np.random.default_rng(count).standard_normal((len(RobotState._fields), count)).astype(np.float32)
    ids = tuple(range(count))
    began = time.monotonic()
    for number in range(messages):
        time.sleep(max(began + number * PERIOD - time.monotonic(), 0.0))
        state = RobotState(*np.roll(columns, number, axis=1).astype(float))
        (message,) = world_messages(EPOCH + number, Robots(ids, (VIRTUAL,) * count, state))
        sender.publish(WORLD_STATE, message)
    received = receive_until(receiver, lambda all_: len(all_) >= messages)
    assert [one.message.utime - EPOCH for one in received] == list(range(messages))
    for number, world in enumerate(all_of(WORLD_STATE, received)):
        assert tuple(world.robot_id) == ids
        found = np.array([getattr(world, name) for name in RobotState._fields], np.float32)
        assert np.array_equal(found, np.roll(columns, number, axis=1))
    assert not receiver.rejected
    assert not sender.unsent


def test_a_large_world_in_packets_of_its_own_arrives_with_every_robot_once(url: str) -> None:
    sender, receiver, view = Bus(url), Bus(url), WorldView()
    receiver.subscribe(WORLD_STATE, every=True)
    count = 2_000
    columns = np.random.default_rng(1).standard_normal((len(RobotState._fields), count)).astype(np.float32)
    parts = world_messages(EPOCH, Robots(tuple(range(count)), (VIRTUAL,) * count, RobotState(*columns)), 1400)
    assert all(len(part.encode()) <= 1400 for part in parts)
    for part in parts:
        sender.publish(WORLD_STATE, part)
    received = receive_until(receiver, lambda all_: len(all_) >= len(parts))
    assert sorted(i for one in all_of(WORLD_STATE, received) for i in one.robot_id) == list(range(count))
    for one in all_of(WORLD_STATE, received):
        view.handle(EPOCH, WORLD_STATE.name, one)
    for i in (0, 41, 42, count - 1):
        robot = view.robot(i)
        assert robot is not None
        assert robot.state.x == columns[0, i]


def test_a_simulator_hears_the_worlds_of_others_and_not_its_own(url: str) -> None:
    own, other = Bus(url), Bus(url)
    own.subscribe(WORLD_STATE, every=True)
    for number in range(5):
        for bus, robot_id in ((own, 1), (other, 2)):
            state = RobotState(*np.full((len(RobotState._fields), 1), float(number)))
            (message,) = world_messages(EPOCH + number, Robots((robot_id,), (VIRTUAL,), state))
            bus.publish(WORLD_STATE, message)
    received = receive_until(own, lambda all_: len(all_) >= 5)
    assert [(one.utime - EPOCH, *one.robot_id) for one in all_of(WORLD_STATE, received + own.receive(0.2))] == [
        (number, 2) for number in range(5)
    ]
