"""cmr-tracker as a process: poses of emulated trackers come on a real bus, and what is wrong is in its status."""

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("natnet", reason="the extra [tracker] is not installed")
pytest.importorskip("qtm_rt", reason="the extra [tracker] is not installed")
from cmr.bus.bus import Bus
from cmr.bus.streams import POSE, PROCESS_STATUS
from cmr.msg import pose_xyt_t, process_status_t
from tests.support.private_bus import private_url
from tests.support.project import PROJECT
from tests.support.trackers.bench import KINDS, Server, server_of
from tests.support.trackers.frame import Emitted
from tests.support.trackers.motion import Robots, measured

pytestmark = pytest.mark.waits
ROBOTS = 3
RATE = 100.0  # Hz
PATIENCE = 60.0  # s


class Emulated:
    """An emulated tracker that sends in a thread until it is stopped, or is to be silent."""

    def __init__(self, kind: str) -> None:
        self.server: Server = server_of(kind)
        self.robots = Robots(ROBOTS, spacing=50.0)  # no two can be confused, however long this computer is busy
        self.is_silent = self._is_over = False
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def close(self) -> None:
        self._is_over = True
        self._thread.join()
        self.server.close()

    def _send(self) -> None:
        random, number = np.random.default_rng(0), 0
        while not self._is_over:
            time.sleep(1.0 / RATE)
            exposed = time.time()  # on this host's clock, so that truth is known at the stamps of poses
            if self.is_silent:
                self.server.poll()
                continue
            number += 1
            self.server.send(Emitted(number, exposed, time.time(), measured(self.robots, exposed, random)))


class Heard:
    """What came on the bus."""

    def __init__(self, url: str) -> None:
        self._bus = Bus(url)
        self._bus.subscribe(POSE, every=True)
        self._bus.subscribe(PROCESS_STATUS, every=True)
        self.poses: list[pose_xyt_t] = []
        self.messages: list[str] = []

    def until(self, is_enough: Callable[[], bool]) -> None:
        """Listen until it is enough."""
        deadline = time.monotonic() + PATIENCE
        while not is_enough():
            assert time.monotonic() < deadline, (len(self.poses), self.messages[-3:])
            for received in self._bus.receive(0.1):
                if isinstance(received.message, pose_xyt_t):
                    self.poses.append(received.message)
                elif isinstance(received.message, process_status_t):
                    self.messages.append(received.message.message)


@contextmanager
def tracker(profile: Path, url: str) -> Iterator["subprocess.Popen[str]"]:
    command = "import sys; from cmr.tracker.command import main; sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen(
        [sys.executable, "-c", command, "--lcm-url", url, "--profile", str(profile)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(PROJECT), *sys.path])},
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def written(folder: Path, kind: str, port: int | None) -> Path:
    robots = "".join(f"  {k}: {{body: robot_{k}}}\n" for k in range(ROBOTS))
    path = folder / "tracker.yaml"
    path.write_text(
        f"schema: 1\ntracker: {{type: {kind}, server: 127.0.0.1, local: 127.0.0.1, port: {port or 'null'}}}\n"
        f"robots:\n{robots}"
    )
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_poses_come_on_the_bus_and_an_outage_is_in_the_status(kind: str, tmp_path: Path) -> None:
    url = private_url()
    emulated, heard = Emulated(kind), Heard(url)
    try:
        with tracker(written(tmp_path, kind, emulated.server.port), url) as process:
            heard.until(lambda: len({pose.robot_id for pose in heard.poses}) == ROBOTS and len(heard.poses) > 60)
            for pose in heard.poses:
                x, y, _ = emulated.robots.at(pose.robot_id, pose.utime / 1e6)
                assert math.hypot(pose.x - x, pose.y - y) < 0.02 + 0.7 * 0.02  # a stamp held up here by 20 ms
            heard.until(lambda: any("frames/s with 3 bodies" in message for message in heard.messages))
            emulated.is_silent = True
            heard.until(lambda: "No frame from the tracker" in heard.messages[-1])
            process.send_signal(signal.SIGTERM)
            assert process.wait(PATIENCE) == 130
    finally:
        emulated.close()


def test_the_mock_of_motioncapture_runs_without_hardware(tmp_path: Path) -> None:
    pytest.importorskip("motioncapture", reason="has no wheel for this Python or processor")
    url = private_url()
    heard = Heard(url)
    path = written(tmp_path, "mock", None)
    with tracker(path, url):
        heard.until(lambda: {pose.robot_id for pose in heard.poses} == {0, 1})


def test_a_type_that_the_package_lacks_ends_with_what_to_do(tmp_path: Path) -> None:
    pytest.importorskip("motioncapture", reason="has no wheel for this Python or processor")
    with tracker(written(tmp_path, "nokov", None), private_url()) as process:
        _, errors = process.communicate(timeout=PATIENCE)
    assert "use the type vrpn" in errors
