"""Rows of encoding WORLD_STATE: CMR's encoder and the generated class, which produce identical bytes."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from benchmarks.drive import EPOCH
from benchmarks.report import Row, seconds
from benchmarks.timing import Timing, clocked, in_turns
from cmr.bus.messages import decode, make
from cmr.bus.streams import WORLD_STATE
from cmr.model.motion import RobotState
from cmr.msg import world_state_t
from cmr.world.view import VIRTUAL, Numbers, Robots, world_messages

ROBOTS = (1_000, 10_000)
UNIT = 1_000  # robots that the goal is for
LONGEST = 15e-6  # s to encode and decode UNIT robots


def codec() -> Iterator[Row]:
    """Measure encoding from arrays and decoding to arrays, as in cmr-sim and its receivers."""
    for count in ROBOTS:
        columns = np.random.default_rng(0).standard_normal((len(RobotState._fields), count))
        robots = Robots(Numbers(range(count)), Numbers([VIRTUAL] * count), RobotState(*columns))
        generated, data = _generated(robots), _encoded(robots)
        _require_same(data, generated)
        works: dict[str, Callable[[], object]] = {
            "encode": partial(_encoded, robots),
            "decode": partial(decode, WORLD_STATE.name, data),
            "generated encode": generated.encode,
            "generated decode": partial(world_state_t.decode, data),
        }
        timings = in_turns({name: clocked(work) for name, work in works.items()})
        encoding, decoding, *generated_times = (_of_unit(timing, count) for timing in timings.values())
        ours, theirs = encoding.median + decoding.median, sum(timing.median for timing in generated_times)
        yield Row(
            f"WORLD_STATE of {count:,} robots, for each {UNIT:,}: encode, decode",
            f"{seconds(encoding)}, {seconds(decoding)}",
            f"{theirs / ours:.0f} times as fast as lcm-gen's class, the same bytes",
            f"together {LONGEST * 1e6:g} us",
            ours <= LONGEST,
        )


def _encoded(robots: Robots) -> bytes:
    (message,) = world_messages(EPOCH, robots)
    data: bytes = message.encode()
    return data


def _require_same(data: bytes, generated: world_state_t) -> None:
    """Raise AssertionError if the bytes, or the values decoded from them, differ from those of the generated class."""
    assert data == generated.encode(), "our bytes differ from those of the generated encoder"
    ours, theirs = decode(WORLD_STATE.name, data).message, world_state_t.decode(data)
    for name in theirs.__slots__:
        assert np.array_equal(getattr(ours, name), getattr(theirs, name)), f"{name} is decoded differently"


def _generated(robots: Robots) -> world_state_t:
    """Return a message of the generated class, with lists as arrays."""
    columns = (column.tolist() for column in robots.state)
    fields = dict(zip(RobotState._fields, columns, strict=True))
    message: world_state_t = make(
        world_state_t, utime=EPOCH, robot_id=list(robots.robot_id), origin=list(robots.origin), **fields
    )
    return message


def _of_unit(timing: Timing, count: int) -> Timing:
    return Timing(timing.median * UNIT / count, timing.fastest * UNIT / count)
