"""States of the view, made of messages, without a bus or a browser."""

from typing import Any

import numpy as np

from cmr.bus.streams import WORLD_STATE
from cmr.bus.world_state import WorldState
from cmr.view.data.intake import Intake
from cmr.view.data.robots import REAL, TWIN, VIRTUAL
from cmr.view.data.state import ViewState
from tests.support.small_log import process_status

NOW = 1_700_000_000_000_000  # us
SECOND = 1_000_000  # us


def world(utime: int, robots: list[tuple[int, int, float, float, float]]) -> WorldState:
    """A WORLD_STATE of robots given as (id, origin, x, y, theta)."""
    ids, origins, *pose = (np.array(column) for column in zip(*robots, strict=True))
    still = np.zeros(len(ids))
    return WorldState(utime, ids, origins, *pose, still, still, still, still)


def three(utime: int, x: float = 0.0) -> WorldState:
    """A real robot with its twin 3 cm ahead, and a virtual one."""
    return world(utime, [(0, REAL, x, 0.0, 0.0), (0, TWIN, x + 0.03, 0.0, 0.0), (27, VIRTUAL, 1.0, x, np.pi)])


def status(process: str, message: str, utime: int = NOW) -> Any:
    return process_status(utime, process=process, message=message)


def showing(*messages: WorldState) -> ViewState:
    state = ViewState()
    for message in messages:
        state.handle(message.utime, WORLD_STATE.name, message)
        state.advance(message.utime)
    return state


def pass_time(state: ViewState, until: int, *messages: WorldState) -> None:
    for message in messages:
        state.handle(message.utime, WORLD_STATE.name, message)
    state.advance(until)


def take_message(state: ViewState, utime: int, channel: str, message: Any) -> None:
    intake = Intake(state)
    intake.take(utime, channel, message.encode())
    intake.flush()
