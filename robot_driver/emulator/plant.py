"""The emulated robot's plant: cmr.plant with the settings' parameters, as controllers and sensors see it.

Every effect and all physics are in cmr.plant; this module applies the settings, and computes battery and encoder
values.
"""

import math
from random import Random

from cmr.plant.beyond_sensors import forward_speed
from cmr.plant.commanded import CommandedRobot
from cmr.plant.parameters import PlantParameters
from cmr.plant.running import PLACES, STEP, RunningRobot
from cmr.plant.sensors import missed, misses, slip_of_way, ticks
from robot_driver.emulator.past import Past, Values
from robot_driver.emulator.settings import Mounting, Settings

__all__ = ["STEP", "Plant", "Wheel"]

TURN = 2.0 * math.pi
NO_DISC = math.inf  # positions in a turn; that of encoder_quantisation is the only one
Pair = tuple[float, float]


class Wheel:
    """The wheels of one side: angle of their shaft and its velocity, forward positive."""

    def __init__(self, robot: RunningRobot, side: str) -> None:
        self._carried = robot.carried
        self._phi, self._psi, self._u = (PLACES[f"{name}_{side}"] for name in ("phi", "psi", "u"))

    @property
    def angle(self) -> float:
        """The angle since the start (rad)."""
        return float(self._carried[self._phi])

    @angle.setter
    def angle(self, angle: float) -> None:
        self._carried[self._phi] = angle

    @property
    def velocity(self) -> float:
        """The velocity (rad/s)."""
        return float(self._carried[self._psi])

    @velocity.setter
    def velocity(self, velocity: float) -> None:
        self._carried[self._psi] = velocity

    @property
    def duty(self) -> float:
        """The duty that reaches the motor."""
        return float(self._carried[self._u])


class Plant:
    """The whole robot at `time` (s since it was switched on).

    `x`, `y` (m) and `theta` (rad, counter-clockwise, never wrapped) are the true pose in the world frame. It moves by
    `parameters`, else by those in the settings for a robot that takes duties.
    """

    def __init__(self, settings: Settings, parameters: PlantParameters | None = None) -> None:
        robot, imperfections = settings.robot, settings.imperfections
        self.parameters: PlantParameters = settings.plant if parameters is None else parameters
        torque = imperfections.torque_noise
        noise = (torque.effective, torque.correlation_time, *slip_of_way(imperfections.slip_noise.effective))
        pose = (robot.x, robot.y, robot.theta)
        self._running = RunningRobot(self.parameters, pose, noise, settings.seed % 2**63)
        self.left, self.right = Wheel(self._running, "left"), Wheel(self._running, "right")
        self._robot = robot
        self._mounting = settings.mounting
        self._electrics = settings.electrics
        self._commanded = CommandedRobot(self._running, self.parameters, Random(f"{settings.seed} commands"))
        self._turned, self._counted, self._counted_at = [0.0, 0.0], [0.0, 0.0], 0.0
        p = self.parameters
        self._headings = Past(p.gyro_latency, [robot.theta]) if p.gyro_latency else None
        self._wheels = Past(p.wheel_speed_latency, self._of_wheels()) if p.wheel_speed_latency else None

    @property
    def time(self) -> float:
        """The time since the robot was switched on (s)."""
        return self._running.time

    @property
    def x(self) -> float:
        """The true x (m)."""
        return float(self._running.carried[PLACES["x"]])

    @x.setter
    def x(self, value: float) -> None:
        self._running.carried[PLACES["x"]] = value

    @property
    def y(self) -> float:
        """The true y (m)."""
        return float(self._running.carried[PLACES["y"]])

    @y.setter
    def y(self, value: float) -> None:
        self._running.carried[PLACES["y"]] = value

    @property
    def theta(self) -> float:
        """The true heading (rad)."""
        return float(self._running.carried[PLACES["theta"]])

    @theta.setter
    def theta(self, value: float) -> None:
        self._running.carried[PLACES["theta"]] = value

    @property
    def v(self) -> float:
        """The forward speed by the wheels (m/s)."""
        return forward_speed(self.parameters, self.left.velocity, self.right.velocity)

    @property
    def w(self) -> float:
        """The yaw rate (rad/s)."""
        return float(self._running.carried[PLACES["w"]])

    def theta_at(self, time: float) -> float:
        """Return the heading at a time up to gyro_latency ago (rad); times never go back."""
        return self.theta if self._headings is None or time >= self.time else self._headings.at(time)[0]

    def command(self, first: float, second: float) -> None:
        """Drive the wheels of each channel with this duty, -1 to 1, from now on; later with a delay, never if it is
        lost.
        """
        self._commanded.command(*_driven(self._mounting, first, second))

    def advance(self, time: float) -> None:
        """Advance to `time` (s); a time in the past changes nothing."""
        self._commanded.advance(time)
        if self._headings is not None:
            self._headings.keep(self.time, [self.theta])
        if self._wheels is not None:
            self._wheels.keep(self.time, self._of_wheels())

    def encoder_counts(self) -> tuple[float, float]:
        """Return the counts at both channels since the start; whole positions of the disc."""
        self._count()
        p, nominal, (left, right) = self.parameters, self._robot.ticks_per_turn, self._counted
        counts = ticks(p, 1.0, left, NO_DISC, nominal), ticks(p, -1.0, right, NO_DISC, nominal)
        return _counted(self._mounting, counts)

    def encoder_speeds(self) -> tuple[float, float]:
        """Return the velocity at both channels in counts per second."""
        _, _, left, right = self._wheels_told()
        return _counted(self._mounting, (self._encoder_speed(1.0, left), self._encoder_speed(-1.0, right)))

    def motor_currents(self) -> tuple[float, float]:
        """Return the current through the motors of both channels in A; positive where the duty drives."""
        _, left, right = self._running.electrics()
        first, second = _channels(self._mounting, left, right)
        return self._electrics.stall_current * first, self._electrics.stall_current * second

    def battery_voltage(self) -> float:
        """Return the voltage at the controller in V."""
        supply, _, _ = self._running.electrics()
        return self._electrics.battery_voltage * supply

    def _of_wheels(self) -> Values:
        """Return the angles (rad) and the velocities (rad/s) of both wheels."""
        return self.left.angle, self.right.angle, self.left.velocity, self.right.velocity

    def _wheels_told(self) -> Values:
        """Return the wheels' state that the encoders report now: that of wheel_speed_latency ago."""
        if self._wheels is None:
            return self._of_wheels()
        return self._wheels.at(self.time - self.parameters.wheel_speed_latency)

    def _encoder_speed(self, s: float, velocity: float) -> float:
        """Return the counts per second of the encoder of one side, s = 1 on the left and -1 on the right."""
        p = self.parameters
        counts = self._robot.ticks_per_turn / TURN * (1.0 + p.encoder_scale) * (1.0 + s * p.encoder_asymmetry)
        return velocity * counts * (1.0 - missed(p, velocity) if misses(p) else 1.0)

    def _count(self) -> None:
        """Add the shafts' motion to the encoder counts; some encoders miss a share of it at speed."""
        turned = list(self._wheels_told()[:2])
        seconds = self.time - self._counted_at
        if not misses(self.parameters):
            self._counted = turned
        elif seconds > 0.0:
            for side in (0, 1):
                step = turned[side] - self._turned[side]
                self._counted[side] += step * (1.0 - missed(self.parameters, step / seconds))
        self._turned, self._counted_at = turned, self.time


def _driven(mounting: Mounting, first: float, second: float) -> Pair:
    """Return the duties of the left and the right motor, positive forward, from those of both channels."""
    left, right = (second, first) if mounting.motors_swapped else (first, second)
    return -left if mounting.left_motor_inverted else left, -right if mounting.right_motor_inverted else right


def _channels(mounting: Mounting, left: float, right: float) -> Pair:
    """Return the values of both channels for those of the left and right motor, the inverse of `_driven`."""
    left, right = -left if mounting.left_motor_inverted else left, -right if mounting.right_motor_inverted else right
    return (right, left) if mounting.motors_swapped else (left, right)


def _counted(mounting: Mounting, forward: Pair) -> Pair:
    """Return the counts of both channels for those of both sides' encoders, each counting forward."""
    left, right = forward
    left = 0.0 if mounting.left_encoder_dead else -left if mounting.left_encoder_inverted else left
    right = 0.0 if mounting.right_encoder_dead else -right if mounting.right_encoder_inverted else right
    return (right, left) if mounting.motors_swapped is not mounting.encoders_swapped else (left, right)
