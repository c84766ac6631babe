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

from cmr.bus.messages import Received, make
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
REASONS = (
    "POSE_0 x not finite",
    "GYRO_0 ahead of this host's clock",
    "MOTOR_FEEDBACK_0 psi_left impossible",
)


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


class Watch:
    """What the simulator reports, with times since it was ready [s]."""

    def __init__(self) -> None:
        self.statuses: list[tuple[float, int, str]] = []  # time, state, message
        self.places: list[tuple[float, ...]] = []  # x, y, theta of the robot
        self._seen: float | None = None
        self._began: float | None = None

    @property
    def now(self) -> float:
        return time.monotonic() - self._began if self._began is not None else -1.0

    def take(self, received: Received, now: float) -> None:
        """Note a world or a status."""
        world, status = received.message_of(WORLD_STATE), received.message_of(PROCESS_STATUS)
        if world is not None and world.n:
            self._seen = time.monotonic() if self._seen is None else self._seen
            self.places.append((world.x[0], world.y[0], world.theta[0]))
        if status is not None and status.process == "cmr-sim":
            self.statuses.append((now, status.state, status.message))
            is_ready = self._seen is not None and time.monotonic() > self._seen + LOADING
            if self._began is None and is_ready and status.state == process_status_t.RUNNING:
                self._began = time.monotonic()


def watched(simulator: subprocess.Popen[bytes], url: str) -> Watch:
    """Send the simulator good messages, and bad ones from BAD_FROM to BAD_UNTIL; return what it reports."""
    watch = Watch()
    with Process("test", url) as process:
        process.subscribe(WORLD_STATE, every=True)
        process.subscribe(PROCESS_STATUS, every=True)
        for utime in process.loop(rate_hz=50.0):
            now = watch.now
            for stream, message in good(utime):
                spoilt = bad(stream, message) if BAD_FROM <= now < BAD_UNTIL else ()
                process.publish_all((stream, 0, one) for one in (*spoilt, message))
            for received in process.received():
                watch.take(received, now)
            assert simulator.poll() is None
            if now > END:
                break
    return watch


def test_a_simulator_lives_through_messages_that_cannot_be(tmp_path: Path) -> None:
    TRUE.save(tmp_path / "robot_0.yaml")
    url = private_url()
    command = [sys.executable, "-m", "cmr", "sim", "--real", "0", "--lcm-url", url]
    simulator = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL)
    try:
        watch = watched(simulator, url)
    finally:
        simulator.terminate()
        simulator.wait(timeout=10.0)
    assert np.abs(np.array(watch.places) - [1.0, 2.0, 0.5]).max() < 0.01
    during = [(state, said) for at, state, said in watch.statuses if BAD_FROM + STATUS < at < BAD_UNTIL]
    assert during
    for state, said in during:
        assert state == process_status_t.DEGRADED
        assert all(reason in said for reason in REASONS), said
    assert "refused" not in watch.statuses[-1][2]
