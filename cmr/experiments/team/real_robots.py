"""The real robots of an experiment: hidden physics, with driver, sensors and pilot as in the live system.

Drivers, gyros and pilots run at 50 Hz, the lowest rate of the live system, poses come at 25 Hz, and a command takes
effect 20 ms after its measurements. The newest command counts for half a second, and duties are rate-limited as in the
driver.
"""

import math
from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, POSE
from cmr.experiments.team.hidden import HiddenRobot
from cmr.experiments.team.plant import Floats, Plant
from cmr.model.body import wrap
from cmr.model.duty_ramp import Limits, Ramp
from cmr.msg import gyro_t, motor_feedback_t, pose_xyt_t
from cmr.recordings.arrivals import COMMANDS_OF
from cmr.recordings.commanding import duties_of
from cmr.world.commands import CommandMemory
from cmr.world.pilot import Pilot

PERIOD = 20_000  # us
POSE_EVERY = 2  # periods
READINGS = 4  # random numbers per period and robot: gyro and pose

OnChannel: TypeAlias = tuple[str, Message]  # channel, message


class RealRobots:
    """Real robots, each with its pilot; `place` are their true poses, (3, n) [m, m, rad].

    `seeds` determine the random numbers of each robot.
    """

    def __init__(
        self,
        pilots: Sequence[Pilot],
        robots: Sequence[HiddenRobot],
        poses: Floats,
        seeds: Sequence[tuple[int, ...]],
    ) -> None:
        self._pilots = pilots
        self._robots = robots
        self._plant = Plant(robots, poses, [(*seed, 0) for seed in seeds])
        self._random = [np.random.default_rng((*seed, 1)) for seed in seeds]
        self._memories = [CommandMemory() for _ in pilots]
        known = [pilot.parameters.parameters for pilot in pilots]
        self._controllers = [None if file is None else file.velocity_controller for file in known]
        self._ramps = [Ramp(Limits(), PERIOD * 1e-6) for _ in pilots]
        self._ticks = self._plant.ticks()
        self.place = self._plant.poses
        self._periods = 0

    @property
    def robot_ids(self) -> list[int]:
        """The ids of the columns of `place`."""
        return [pilot.robot_id for pilot in self._pilots]

    def advance(self, utime: int) -> Iterator[OnChannel]:
        """Simulate a period until `utime` [us]; yield the messages of drivers, gyros and cameras."""
        if not self._pilots:
            return
        self._periods += 1
        self._plant.advance(self._periods * PERIOD * 1e-6)
        duties = [self._serve(column, utime) for column in range(len(self._pilots))]
        self._plant.command(duties)
        ticks, before = self._plant.ticks(), self.place
        self.place = self._plant.poses
        turned = (self.place[2] - before[2]) / (PERIOD * 1e-6)
        for column, pilot in enumerate(self._pilots):
            measured = self._measured(column, pilot.robot_id, utime, ticks, float(turned[column]), duties[column])
            for channel, message in measured:
                pilot.handle(utime, channel, message)
                yield channel, message
        self._ticks = ticks

    def hear(self, utime: int, messages: Sequence[OnChannel]) -> None:
        """Pass these messages to all pilots."""
        for pilot in self._pilots:
            for channel, message in messages:
                pilot.handle(utime, channel, message)

    def decide(self, utime: int) -> Iterator[OnChannel]:
        """Yield the commands of all pilots, which the drivers receive in the next period."""
        for column, (pilot, memory) in enumerate(zip(self._pilots, self._memories, strict=True)):
            stream, command = COMMANDS_OF[pilot.kind], pilot.command(utime)
            memory.take(utime, *(duties_of(command, self._controllers[column]) or (0.0, 0.0)))
            yield stream.channel(pilot.robot_id), command

    def _serve(self, column: int, utime: int) -> tuple[float, float]:
        """Return the duties that a driver sends now, or those equivalent to a commanded speed."""
        if self._controllers[column] is not None:
            return self._memories[column].at(utime)
        ramp = self._ramps[column]
        duties = ramp.towards(*self._memories[column].at(utime), utime * 1e-6)
        ramp.confirm()
        return duties

    def _measured(
        self, column: int, robot_id: int, utime: int, ticks: Floats, turned: float, duties: tuple[float, float]
    ) -> Iterator[OnChannel]:
        robot = self._robots[column]
        noise = self._random[column].standard_normal(READINGS)
        psi = (ticks[:, column] - self._ticks[:, column]) * 2.0 * math.pi / robot.ticks_per_turn / (PERIOD * 1e-6)
        # The yaw rate is that of the period before the feedback: a gyro is fast enough not to be a period late.
        rate = turned + robot.gyro_bias + robot.gyro_noise * float(noise[0])
        gyro = make(gyro_t, utime=utime, robot_id=robot_id, yaw_rate=rate, valid=1, received_utime=utime)
        yield GYRO.channel(robot_id), gyro
        # the controller's internal duties are not reported
        applied = duties if self._controllers[column] is None else (math.nan, math.nan)
        yield MOTOR_FEEDBACK.channel(robot_id), _feedback(utime, robot_id, ticks[:, column], psi, applied)
        if self._periods % POSE_EVERY == 1:  # also in the first: the simulator must not show a robot at a wrong place
            deviation = noise[1:4] * (robot.position_noise, robot.position_noise, robot.heading_noise)
            x, y, theta = (self.place[:, column] + deviation).tolist()
            pose = make(pose_xyt_t, utime=utime, robot_id=robot_id, x=x, y=y, theta=float(wrap(theta)))
            yield POSE.channel(robot_id), pose


def _feedback(utime: int, robot_id: int, ticks: Floats, psi: Floats, duties: tuple[float, float]) -> motor_feedback_t:
    return make(
        motor_feedback_t,
        utime=utime,
        robot_id=robot_id,
        ticks_left=int(ticks[0]),
        ticks_right=int(ticks[1]),
        psi_left=float(psi[0]),
        psi_right=float(psi[1]),
        applied_left=duties[0],
        applied_right=duties[1],
        current_left=math.nan,
        current_right=math.nan,
        battery_voltage=math.nan,
        temperature=math.nan,
        status=0,
        received_utime=utime,
        applied_utime=0 if math.isnan(duties[0]) else utime,
    )
