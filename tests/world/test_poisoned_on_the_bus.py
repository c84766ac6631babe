"""cmr-sim itself, on a bus of its own, lives through messages that cannot be, and says so while they come."""

import copy
import math
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.bus.messages import make
from cmr.bus.process import Process
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, POSE, PROCESS_STATUS, WORLD_STATE
from cmr.msg import gyro_t, motor_feedback_t, pose_xyt_t, process_status_t
from tests.support.private_bus import private_url
from tests.world.test_world import TRUE

pytestmark = [pytest.mark.waits, pytest.mark.real_time]

HOUR = 3_600_000_000  # us
BAD_FROM, BAD_UNTIL, END = 1.0, 3.5, 8.0  # s since the simulator was ready
LOADING = 2.0  # s since the robot was seen first, after which it says whether its model is loaded
STATUS = 1.0  # s between two reports


def good(utime: int) -> Iterator[tuple[Any, Any]]:
    """Yield what a robot that stands at (1, 2) measures."""
    feedback = motor_feedback_t()
    feedback.utime = utime
    yield MOTOR_FEEDBACK, feedback
    yield GYRO, make(gyro_t, utime=utime, robot_id=0, yaw_rate=0.0, valid=1, received_utime=utime)
    yield POSE, make(pose_xyt_t, utime=utime, robot_id=0, x=1.0, y=2.0, theta=0.5)


def bad(stream: Any, message: Any) -> Iterator[Any]:
    """Yield messages that cannot be, made of a good one."""
    name = {POSE: "x", GYRO: "yaw_rate", MOTOR_FEEDBACK: "psi_left"}[stream]
    for value in (math.nan, math.inf, 1e300, 1_000.0):
        one = copy.copy(message)
        setattr(one, name, value)
        yield one
    for offset in (HOUR, -HOUR):
        one = copy.copy(message)
        one.utime += offset
        yield one


def test_a_simulator_lives_through_messages_that_cannot_be(tmp_path: Path) -> None:
    TRUE.save(tmp_path / "robot_0.yaml")
    url = private_url()
    command = [sys.executable, "-m", "cmr", "sim", "--real", "0", "--lcm-url", url]
    statuses: list[tuple[float, int, str]] = []
    places: list[tuple[float, tuple[float, ...]]] = []
    seen: float | None = None
    began: float | None = None
    simulator = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL)
    try:
        with Process("test", url) as process:
            process.subscribe(WORLD_STATE, every=True)
            process.subscribe(PROCESS_STATUS, every=True)
            for utime in process.loop(rate_hz=50.0):
                now = time.monotonic() - began if began is not None else -1.0
                for stream, message in good(utime):
                    spoilt = bad(stream, message) if BAD_FROM <= now < BAD_UNTIL else ()
                    process.publish_all((stream, 0, one) for one in (*spoilt, message))
                for received in process.received():
                    world, status = received.message_of(WORLD_STATE), received.message_of(PROCESS_STATUS)
                    if world is not None and world.n:
                        seen = time.monotonic() if seen is None else seen
                        places.append((now, (world.x[0], world.y[0], world.theta[0])))
                    if status is not None and status.process == "cmr-sim":
                        statuses.append((now, status.state, status.message))
                        is_ready = seen is not None and time.monotonic() > seen + LOADING
                        if began is None and is_ready and status.state == process_status_t.RUNNING:
                            began = time.monotonic()
                assert simulator.poll() is None
                if now > END:
                    break
    finally:
        simulator.terminate()
        simulator.wait(timeout=10.0)
    here = np.array([place for _, place in places])
    assert np.abs(here - [1.0, 2.0, 0.5]).max() < 0.01
    during = [(state, said) for at, state, said in statuses if BAD_FROM + STATUS < at < BAD_UNTIL]
    assert during
    for state, said in during:
        assert state == process_status_t.DEGRADED
        for reason in (
            "POSE_0 x not finite",
            "GYRO_0 ahead of this host's clock",
            "MOTOR_FEEDBACK_0 psi_left impossible",
        ):
            assert reason in said
    assert "refused" not in statuses[-1][2]
