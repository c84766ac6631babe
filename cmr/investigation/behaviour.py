"""Investigate: choose movements that show what the robot's simulation gets wrong."""

from collections.abc import Iterator

import numpy as np

from cmr.bus.message import Message
from cmr.bus.messages import now_utime
from cmr.bus.streams import INVESTIGATION_STATUS, Stream
from cmr.geometry.obstacles import Geofence
from cmr.investigation.driving import AtOnce, Driving, InThread, Place, Planner
from cmr.investigation.engine import LONGEST, Investigation
from cmr.investigation.floor import MARGIN, Floor
from cmr.investigation.rehearsing import rehearse
from cmr.investigation.reporting import Reports
from cmr.investigation.sensing import VirtualSensors
from cmr.model.body import forward
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recorder
from cmr.world.behaviours.behaviour import Behaviour
from cmr.world.behaviours.waypoints import read_points
from cmr.world.view import VIRTUAL, Robot, WorldView

NEEDS_FLOOR = "investigate needs a floor: give --geofence, or floor=X1:Y1/X2:Y2/...: its corners [m; world frame]."
DIAGNOSIS, CALIBRATION = "diagnosis", "calibration"
ANOTHER_TIME = 60_000_000  # us; no clock of a robot's world is that wrong
NAMES = ("wheel_radius", "k2_over_k3", "k1", "base_width")


class Investigate(Behaviour):
    """Find out on a floor what the robot's model gets wrong, in up to `longest` s of driving.

    `floor` lists the corners X1:Y1/X2:Y2/... [m; world frame] of a polygon, by default those of the geofence. The
    robot's centre keeps `margin` [m] inside of it. The same `seed` draws the same movements. With the `goal`
    calibration it ends as soon as k1 and base_width are known within 1 %, k2_over_k3 within 3 % (two standard
    deviations).
    """

    def __init__(
        self,
        floor: str = "",
        margin: float = MARGIN,
        longest: float = LONGEST,
        seed: int = 0,
        goal: str = DIAGNOSIS,
        planner: Planner | None = None,
    ) -> None:
        if margin < 0.0 or longest <= 0.0:
            raise ValueError("margin must be 0 or more, longest above 0")
        self._fence = Geofence(zip(*read_points(floor), strict=True)) if floor else None
        if goal not in (DIAGNOSIS, CALIBRATION):
            raise ValueError(f"goal must be {DIAGNOSIS} or {CALIBRATION}")
        self._margin, self._longest, self._seed = margin, longest, seed
        self._calibrate = goal == CALIBRATION
        self._planner = planner
        self._recorder: Recorder | None = None
        self._floor: Floor | None = None
        self.driving: Driving | None = None
        self._reports: Reports | None = None
        self._sensors = VirtualSensors()

    def hear(self, utime: int, channel: str, message: Message) -> None:
        """Record the messages of the robot's driver and sensors."""
        if self._recorder is None:
            self._recorder = Recorder(int(channel.rpartition("_")[2]))
        self._recorder.handle(utime, channel, message)

    def prepare(self) -> None:
        """Load the modules for deciding: in the first cycle, that would exceed the 0.5 s until a robot is stopped."""
        rehearse()

    def command(self, utime: int, me: Robot, world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the current duties."""
        if me.origin != VIRTUAL:
            return self._decide(utime, me, world, parameters)
        for channel, message in self._sensors.read(me):
            self.hear(message.utime, channel, message)
        duties = self._decide(utime, me, world, parameters)
        self._sensors.driven(utime, duties)
        return duties

    def _decide(self, utime: int, me: Robot, world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        if self._recorder is None:
            return 0.0, 0.0  # no measurement yet
        if self.driving is None:
            fence = self._fence or world.geofence
            if fence is None:
                self.finished, self.problem = True, NEEDS_FLOOR
                return 0.0, 0.0
            self._floor = Floor(fence, margin=self._margin, obstacles=world.obstacles)
            self.driving = self._driving(utime, me.robot_id, parameters, self._recorder)
            self._reports = Reports(self.driving, me.robot_id)
        self.driving.investigation.floor = self._with_others(me, world)
        state = me.state
        speed = float(forward(state.psi_left, state.psi_right, parameters))
        duties = self.driving.command(utime, Place(state.x, state.y, state.theta, speed))
        self.finished, self.problem = self.driving.finished, self.driving.problem
        return duties

    def tell(self, utime: int) -> Iterator[tuple[Stream[Message], Message]]:
        """Yield the remaining explanations, and the next movement with its reason."""
        for report in self._reports.due(utime) if self._reports is not None else ():
            yield INVESTIGATION_STATUS, report

    def _with_others(self, me: Robot, world: WorldView) -> Floor:
        """Return the floor with the other robots at their present positions."""
        assert self._floor is not None
        around = world.surroundings()
        others = around.members.robot_id != me.robot_id
        places = list(zip(around.x[others].tolist(), around.y[others].tolist(), strict=True))
        return self._floor.with_robots(places) if places else self._floor

    def _driving(self, utime: int, robot_id: int, parameters: RobotParameters, recorder: Recorder) -> Driving:
        assert self._floor is not None
        known = {name: Value(float(np.asarray(parameters.values[name]))) for name in NAMES}
        nominal = ParameterFile(robot_id, known)
        investigation = Investigation(
            nominal, self._floor, seed=self._seed, longest=self._longest, calibrate=self._calibrate
        )
        return Driving(investigation, recorder.recording, self._planner or _planner_at(utime))


def _planner_at(utime: int) -> Planner:
    """Return the planner for `utime` [us]. A time that is not this computer's is simulated: then the planner waits."""
    return InThread() if abs(utime - now_utime()) < ANOTHER_TIME else AtOnce()
