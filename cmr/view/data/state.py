"""The state shown at one moment, from messages of the bus or a log."""

from collections import deque
from dataclasses import dataclass
from typing import Generic

import numpy as np

from cmr.bus.channel_statistics import ChannelStatistics
from cmr.bus.estop import EmergencyStop
from cmr.bus.message import M, M_co, Message
from cmr.bus.senders import keep
from cmr.bus.streams import Stream, identify
from cmr.msg import (
    calibration_status_t,
    camera_image_t,
    investigation_status_t,
    parameters_t,
    pose_xyt_t,
    process_status_t,
    range_scan_t,
    robot_state_t,
    waypoints_t,
    world_state_t,
)
from cmr.parameters.versions import Versions
from cmr.view.data.drives import Drives
from cmr.view.data.robots import GONE_AFTER, Robots, RobotTable
from cmr.view.data.trails import Trails

COMMANDS = ("MOTOR_COMMAND", "WHEEL_SPEED_COMMAND", "VELOCITY_COMMAND")  # a robot takes one kind
LATEST_OF = (*COMMANDS, "MOTOR_FEEDBACK", "GYRO", "POSE", "RANGE_SCAN", "WAYPOINTS", "PARAMETERS")
WITH_ARRAYS = ("RANGE_SCAN", "WAYPOINTS")
MOST_ROBOTS = 2_000  # robots shown; senders may use any number of ids
MOST_ESTIMATES = 600  # kept per calibration
MOST_DECISIONS = 300  # reports kept per investigation
REPEATED = 3.5  # s by which the driven time may decrease when a movement is aborted
MOST_DISTANCES = 480  # kept per robot and twin: two minutes
RATE_WINDOW = 3_000_000  # us over which rates of channels are taken
STOPPED_FOR = 10_000_000  # us for which an ended process is shown
SILENT_FOR = 60_000_000  # us after which a silent process or camera is dropped
DIAGNOSIS = "cmr-diagnose"


@dataclass(frozen=True)
class Arrival(Generic[M_co]):
    """A message and its time of arrival [us]."""

    utime: int
    message: M_co


class ViewState:
    """The world, the processes and the bus at `now` [us].

    `latest` holds the last message of each robot by the stream's name; `calibrations`, `investigations` and
    `divergence` are histories by robot: CALIBRATION_STATUS_N, INVESTIGATION_STATUS_N, and (moment, distance of robot
    and twin [m]). `drives` are of robots and twins. `cameras` holds the last picture of each by its name.
    """

    def __init__(self) -> None:
        self.now = 0
        self.robots = RobotTable()
        self.trails = Trails()
        self.traffic = ChannelStatistics(RATE_WINDOW)
        self.estop = EmergencyStop()
        self.processes: dict[tuple[str, str, int], Arrival[process_status_t]] = {}
        self.latest: dict[str, dict[int, Arrival[Message]]] = {name: {} for name in LATEST_OF}
        self.cameras: dict[str, Arrival[camera_image_t]] = {}
        self.calibrations: dict[int, deque[Arrival[calibration_status_t]]] = {}
        self.investigations: dict[int, deque[Arrival[investigation_status_t]]] = {}
        self.divergence: dict[int, deque[tuple[int, float]]] = {}
        self.drives = Drives()
        self._versions: dict[int, Versions] = {}
        self._known: set[int] = set()

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Handle a message received at `utime` [us]."""
        stream, robot_id = identify(channel) or (None, None)
        if stream is None or (robot_id is not None and self._is_one_too_many(robot_id)):
            return
        name = stream.name
        if robot_id is not None and name in self.latest and not self._is_outdated(utime, robot_id, message):
            self.latest[name][robot_id] = Arrival(utime, message)
        self.estop.handle(utime, channel, message)
        if isinstance(message, world_state_t):
            self.robots.take_world(utime, message)
        elif isinstance(message, robot_state_t):
            self.robots.take_state(utime, message)
        elif isinstance(message, pose_xyt_t):
            self.robots.take_pose(utime, message)
        elif isinstance(message, process_status_t):
            keep(self.processes, (message.process, message.host, message.pid), Arrival(utime, message))
        elif isinstance(message, camera_image_t):
            keep(self.cameras, message.camera, Arrival(utime, message))
        elif isinstance(message, calibration_status_t):
            self._take_calibration(message.robot_id, Arrival(utime, message))
        elif isinstance(message, investigation_status_t):
            self._take_investigation(message.robot_id, Arrival(utime, message))

    def advance(self, now: int) -> None:
        """Advance time to `now` [us]."""
        self.now = now
        drives_are_due, trails_are_due = self.drives.due(now), self.trails.due(now)
        if not (drives_are_due or trails_are_due):
            return
        present = self.robots.present(now)
        fresh = present.fresh()
        real, twins = fresh.with_twins()
        if drives_are_due:
            self.drives.sample(now, real, twins)
        if trails_are_due:
            self.trails.sample(now, fresh)
            self._measure_divergence(now, real, twins)
            self._forget_silent(now)
            there = set(present.robot_id.tolist())
            self.divergence = {
                robot_id: heard_last for robot_id, heard_last in self.divergence.items() if robot_id in there
            }

    def present(self) -> Robots:
        """Return the robots present now."""
        return self.robots.present(self.now)

    def has_left(self, robot_id: int) -> bool:
        """Return whether a robot is not in the world, and has itself been silent for SILENT_FOR."""
        heard_last = [heard[robot_id].utime for heard in self.latest.values() if robot_id in heard]
        return robot_id not in self.present().robot_id and self.now - max(heard_last, default=0) > SILENT_FOR

    def heard_channels(self) -> list[str]:
        """Return the active channels, without those of robots that have left."""
        there = {None, *self.present().robot_id.tolist()}
        known = [(channel, age, identify(channel)) for channel, age in self.traffic.ages(self.now)]
        return [name for name, age, identity in known if identity and (identity[1] in there or age <= GONE_AFTER)]

    def array_lengths(self) -> dict[str, int]:
        """Return the array lengths in the last message, by channel, for channels with arrays."""
        return {
            f"{name}_{robot_id}": heard.message.n
            for name in WITH_ARRAYS
            for robot_id, heard in self.latest[name].items()
            if isinstance(heard.message, (range_scan_t, waypoints_t))
        }

    def diagnosis(self) -> str:
        """Return the message of the live diagnosis; empty if none runs."""
        return " ".join(
            heard_last.message.message for (name, _, _), heard_last in self.processes.items() if name == DIAGNOSIS
        )

    def newest(self, stream: Stream[M], robot_id: int) -> M | None:
        """Return the last message of a robot on one of the streams LATEST_OF; None if there was none."""
        heard = self.latest[stream.name].get(robot_id)
        return heard.message if heard is not None and isinstance(heard.message, stream.message_type) else None

    def _is_one_too_many(self, robot_id: int) -> bool:
        """Return whether a robot is omitted because there are too many."""
        if robot_id in self._known or len(self._known) < MOST_ROBOTS:
            self._known.add(robot_id)
            return False
        return True

    def _is_outdated(self, utime: int, robot_id: int, message: Message) -> bool:
        """Return whether these are parameters with an older version than a known one."""
        if not isinstance(message, parameters_t):
            return False
        return self._versions.setdefault(robot_id, Versions()).is_outdated(message, utime)

    def _take_calibration(self, robot_id: int, heard_last: Arrival[calibration_status_t]) -> None:
        history = self.calibrations.setdefault(robot_id, deque(maxlen=MOST_ESTIMATES))
        if history and heard_last.message.progress < history[-1].message.progress and heard_last.message.state == 0:
            history.clear()  # another drive begins
        done = calibration_status_t.DONE
        if heard_last.message.state == done and not (history and history[-1].message.state == done):
            self.drives.calibrated(robot_id)
        history.append(heard_last)

    def _take_investigation(self, robot_id: int, heard_last: Arrival[investigation_status_t]) -> None:
        history = self.investigations.setdefault(robot_id, deque(maxlen=MOST_DECISIONS))
        if history and heard_last.message.driven < history[-1].message.driven - REPEATED:
            history.clear()  # another drive begins
        history.append(heard_last)

    def _measure_divergence(self, now: int, real: Robots, twins: Robots) -> None:
        distances = np.hypot(*(real.pose[:2] - twins.pose[:2]))
        for robot_id, distance in zip(real.robot_id.tolist(), distances.tolist(), strict=True):
            self.divergence.setdefault(robot_id, deque(maxlen=MOST_DISTANCES)).append((now, distance))

    def _forget_silent(self, now: int) -> None:
        self.investigations = {
            robot_id: heard for robot_id, heard in self.investigations.items() if now - heard[-1].utime <= SILENT_FOR
        }
        self.cameras = {name: heard for name, heard in self.cameras.items() if now - heard.utime <= SILENT_FOR}
        for key, heard_last in list(self.processes.items()):
            is_over = heard_last.message.state == process_status_t.STOPPING
            if now - heard_last.utime > (STOPPED_FOR if is_over else SILENT_FOR):
                del self.processes[key]
