"""The page shows robots where they are, whatever numbers stand in messages of strangers."""

import math
from typing import Any

import pytest

from cmr.bus.fields import fields_of
from cmr.bus.messages import make
from cmr.bus.streams import POSE, ROBOT_STATE, WORLD_STATE, Stream
from cmr.msg import pose_xyt_t, robot_state_t, world_state_t
from cmr.view.data.intake import Intake
from cmr.view.data.state import ViewState

EPOCH = 1_800_000_000_000_000  # us
PERIOD = 20_000  # us
STREAMS: dict[Stream[Any], Any] = {POSE: pose_xyt_t, ROBOT_STATE: robot_state_t, WORLD_STATE: world_state_t}
CASES = [
    (stream, field.name, value)
    for stream, kind in STREAMS.items()
    for field in fields_of(kind)
    for value in (math.nan, math.inf, 1e300)
    if field.wire_type in ("double", "float") and not (field.wire_type == "float" and value == 1e300)
]


def good(stream: Stream[Any], utime: int) -> Any:
    state = dict.fromkeys(("psi_left", "psi_right", "domega_left", "domega_right"), 0.5)
    place = {"x": 1.0, "y": 2.0, "theta": 0.5}
    if stream is POSE:
        return make(pose_xyt_t, utime=utime, robot_id=7, **place)
    if stream is ROBOT_STATE:
        return make(robot_state_t, utime=utime, robot_id=7, origin=0, **place, **state)
    columns = {name: [value] for name, value in {**place, **state}.items()}
    return make(world_state_t, utime=utime, robot_id=[7], origin=[0], **columns)


@pytest.mark.parametrize(("stream", "name", "value"), CASES, ids=lambda one: getattr(one, "name", one))
def test_a_robot_stays_where_it_was_and_the_channel_is_marked(stream: Stream[Any], name: str, value: float) -> None:
    state = ViewState()
    intake, channel = Intake(state), stream.channel(None if stream is WORLD_STATE else 7)
    for k in range(20):
        utime = EPOCH + k * PERIOD
        message = good(stream, utime)
        if k % 2:
            setattr(message, name, [value] if stream is WORLD_STATE else value)
        intake.take(utime, channel, message.encode())
        intake.flush()
        state.advance(utime)
        assert state.present().place(7) == (1.0, 2.0, 0.5)
    (line,) = state.traffic.lines(state.now)
    assert (line.messages, line.errors) == (20, 10)
