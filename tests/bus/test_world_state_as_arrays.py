"""WORLD_STATE read as arrays says what the generated class reads, and robots' ids are the same however they come."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.bus.messages import decode, make
from cmr.bus.streams import WORLD_STATE
from cmr.model.motion import RobotState
from cmr.msg import world_state_t
from cmr.world.behaviours.path_following import SEARCH_AHEAD, look_around, pursue
from cmr.world.behaviours.paths import TARGET, Paths
from cmr.world.view import VIRTUAL, Numbers, Robot, Robots, numbers_of, world_messages
from tests.support.typed_messages import all_of

EPOCH = 1_700_000_000_000_000  # us


@given(st.integers(0, 50), st.integers(0, 2**32 - 1))
def test_what_is_read_as_arrays_is_what_the_generated_class_reads(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    columns = random.standard_normal((len(RobotState._fields), n)).tolist()
    ids, origins = random.integers(0, 2**31, n).tolist(), random.integers(0, 3, n).tolist()
    fields = dict(zip(RobotState._fields, columns, strict=True))
    data = make(world_state_t, utime=EPOCH, robot_id=ids, origin=origins, **fields).encode()
    ours, generated = decode(WORLD_STATE.name, data).message, world_state_t.decode(data)
    for name in world_state_t.__slots__:
        assert np.array_equal(getattr(ours, name), getattr(generated, name)), name
    assert ours.encode() == data


@pytest.mark.filterwarnings("error")
def test_bits_that_are_no_number_are_none_without_a_word_on_the_terminal() -> None:
    state = {name: [0.0] for name in RobotState._fields}
    data = make(world_state_t, utime=EPOCH, robot_id=[1], origin=[0], **state).encode()
    signalling = data[:-4] + bytes.fromhex("7fa00000")
    assert np.isnan(as_array(decode(WORLD_STATE.name, signalling).message)[-1])


def as_array(message: Any) -> Any:
    return np.array([getattr(message, name)[0] for name in RobotState._fields])


@pytest.mark.parametrize("largest", [None, 100, 1400])
def test_messages_in_parts_have_the_bytes_of_messages_in_one(largest: int | None) -> None:
    robots = [Robot(EPOCH, i, VIRTUAL, RobotState(*(float(i) + field for field in range(7)))) for i in range(100)]
    messages = all_of(
        WORLD_STATE, [decode(WORLD_STATE.name, one.encode()) for one in world_messages(EPOCH, robots, largest)]
    )
    assert np.concatenate([one.robot_id for one in messages]).tolist() == list(range(100))
    assert np.concatenate([one.domega_right for one in messages]).tolist() == [robot.state[6] for robot in robots]


def test_numbers_are_a_tuple_that_is_the_same_object_for_the_same_numbers() -> None:
    numbers = numbers_of([3, 1, 2])
    assert numbers == (3, 1, 2)
    assert hash(numbers) == hash((3, 1, 2))
    assert numbers_of(np.array([3, 1, 2])) is numbers
    assert np.array_equal(np.asarray(Numbers([3, 1, 2])), [3, 1, 2])
    assert np.array_equal(np.array(numbers, np.int32)[1:], [1, 2])


def test_robots_put_together_are_all_there_in_order() -> None:
    first, second = (Robots.of([Robot(EPOCH, i, VIRTUAL, RobotState.at_rest(float(i)))]) for i in (4, 2))
    both = first.with_others(second)
    assert (both.robot_id, both.origin, list(both.state.x)) == ((4, 2), (VIRTUAL, VIRTUAL), [4.0, 2.0])
    nobody = Robots.of([])
    assert first.with_others(nobody).robot_id == nobody.with_others(first).robot_id == (4,)


@given(st.integers(0, 2**32 - 1))
def test_the_search_along_a_path_finds_the_nearest_point_though_it_leaves_pieces_out(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = np.cumsum(random.uniform(-0.08, 0.1, (2, 30)), axis=1)
    lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(points))))
    place = points[:, random.integers(0, 30)] + random.normal(0.0, random.uniform(0.0, 0.1), 2)
    start = float(random.uniform(0.0, lengths[-1]))
    progress, piece = np.array([start]), np.array([np.searchsorted(lengths, start, "right") - 1])
    first, target = int(piece[0]), np.empty((3, 1))
    path = np.column_stack([*points, lengths, np.zeros(30)])[np.newaxis]
    look_around(path, 0, 0, 29)
    pursue(
        *(np.zeros(1, np.int64), path, np.array([30]), lengths[-1:].copy(), np.zeros((1, TARGET + 2, 4))),
        *(place[:1].copy(), place[1:].copy()),
        *(0.15, progress, piece, *target),
    )
    nearest = np.inf
    for i in range(first, 29):
        if lengths[i] <= start + SEARCH_AHEAD:
            share = np.linspace(max(start - lengths[i], 0.0) / (lengths[i + 1] - lengths[i]), 1.0, 200)
            line = points[:, [i]] + share * (points[:, [i + 1]] - points[:, [i]])
            nearest = min(nearest, float(np.hypot(*(line - place[:, np.newaxis])).min()))
    reached = [np.interp(progress[0], lengths, row) for row in points]
    assert np.hypot(*(np.array(reached) - place)) <= nearest + 1e-9


@given(st.integers(0, 2**32 - 1))
def test_what_is_kept_of_a_path_around_its_robot_tells_the_same_as_the_path(seed: int) -> None:
    random = np.random.default_rng(seed)
    x, y = np.cumsum(random.uniform(-0.1, 0.12, (2, 60)), axis=1).tolist()
    paths = [Paths(), Paths()]
    for one in paths:
        one.put(0, x, y)
    found = [(np.zeros(1), np.zeros(1, np.int64), *np.empty((3, 1))) for _ in paths]
    place, row = np.array([[x[0]], [y[0]]]), np.zeros(1, np.int64)
    for _ in range(100):
        paths[1].around[:] = 0.0  # so it has to look at the path each time
        for one, (progress, piece, target_x, target_y, remaining) in zip(paths, found, strict=True):
            place_and_reach = (place[0], place[1], 0.15)
            pursue(row, *one.arrays, *place_and_reach, progress, piece, target_x, target_y, remaining)
        assert np.array_equal(found[0], found[1])
        toward = np.array(found[0][2:4]) - place
        place += 0.02 * toward / np.hypot(*toward) + random.normal(0.0, 0.002, (2, 1))
