"""Differential-drive controllers of other software: ROS 2's diff_drive_controller, and Gazebo's DiffDrive.

Such a controller converts (v, omega) to wheel speeds, and wheel angles to odometry, by the wheel separation S and the
wheel radius R of a robot description. The calibrated robot of base width b and radii r_left, r_right turns by

    omega (S / R) (r / b)

when omega is commanded: multipliers b / S and r / R correct that to omega.
"""

from dataclasses import dataclass

from cmr.exporting.carried import ROS2_CONTROL, what_is_carried
from cmr.exporting.robot import ExportedRobot

LEAST_SHARE = 1e-3  # largest share by which wheels miss a commanded speed without a remark


@dataclass(frozen=True)
class Described:
    """Data of a robot description: wheel separation and wheel radius [m]."""

    separation: float
    radius: float


@dataclass(frozen=True)
class Calibrated:
    """Data of the calibrated robot: base width, radii [m], and its largest speed, turn rate and their derivatives."""

    separation: float
    radius_left: float
    radius_right: float
    speed: float
    turn_rate: float
    acceleration: float
    turn_acceleration: float

    @property
    def radius(self) -> float:
        """The mean radius [m]."""
        return (self.radius_left + self.radius_right) / 2.0


def calibrated(robot: ExportedRobot) -> Calibrated:
    """Return the parameters of the robot that a differential-drive controller needs."""
    value = robot.value
    radius = value("wheel_radius") * (1.0 + value("wheel_radius_scale"))
    apart = value("wheel_radius_asymmetry")
    width, fastest = value("base_width"), min(1.0, value("saturation")) / value("k1")
    # From rest at full duty; the duty itself may be ramped.
    quickest = min(
        value("k2_over_k3") * min(1.0, value("saturation"), value("current_limit")), value("slew_limit") / value("k1")
    )
    return Calibrated(
        width,
        radius * (1.0 + apart),
        radius * (1.0 - apart),
        radius * fastest,
        min(2.0 * radius * fastest / width, value("turn_rate_limit")),
        radius * quickest,
        2.0 * radius * quickest / width,
    )


def described(robot: ExportedRobot, separation: float | None, radius: float | None) -> Described:
    """Return the robot description's data; by default those that the robot's own controller uses.

    Without a controller, they are those of the calibration.
    """
    if robot.controller is None:
        known = calibrated(robot)
        counted, counted_radius = known.separation, known.radius
    else:
        counted = robot.controller.base_width * (1.0 + robot.value("wheel_separation_error"))
        counted_radius = robot.controller.wheel_radius
    return Described(separation or counted, radius or counted_radius)


def turned_before(robot: ExportedRobot, said: Described) -> float:
    """Return the angle [degrees] by which the robot turns when commanded 360 degrees with the description's data."""
    known = calibrated(robot)
    return 360.0 * (said.separation / said.radius) * (known.radius / known.separation)


def ros2_control(robot: ExportedRobot, said: Described) -> str:
    """Return parameters of diff_drive_controller, ready to paste."""
    known = calibrated(robot)
    carried = "\n".join(f"# {line}" for line in what_is_carried(ROS2_CONTROL, robot))
    return f"""\
# Robot {robot.robot_id} of Calibrated Mixed Reality, as it was calibrated: written by cmr-export for
# diff_drive_controller of ROS 2.
#
# A slow turn of 360 degrees, commanded with the wheel separation and radius of the description alone, is one of
# {turned_before(robot, said):.1f} degrees. With these multipliers it is one of 360.
{_reached(robot)}#
# Controllers of ROS 2 Humble ignore limits without has_velocity_limits: true and has_acceleration_limits: true beside
# them, under linear.x and angular.z.
#
{carried}
diff_drive_controller:
  ros__parameters:
    wheel_separation: {said.separation:.6g}  # m, of the description
    wheel_radius: {said.radius:.6g}  # m, of the description
    wheel_separation_multiplier: {known.separation / said.separation:.6f}
    left_wheel_radius_multiplier: {known.radius_left / said.radius:.6f}
    right_wheel_radius_multiplier: {known.radius_right / said.radius:.6f}
    linear:
      x:
        max_velocity: {known.speed:.6g}  # m/s
        min_velocity: {-known.speed:.6g}
        max_acceleration: {known.acceleration:.6g}  # m/s^2
    angular:
      z:
        max_velocity: {known.turn_rate:.6g}  # rad/s
        min_velocity: {-known.turn_rate:.6g}
        max_acceleration: {known.turn_acceleration:.6g}  # rad/s^2
"""


def _reached(robot: ExportedRobot) -> str:
    """Return a comment for robots whose wheels do not reach the commanded speed; empty for others."""
    if robot.controller is None:
        return ""
    share = 1.0 / (robot.value("k1") * robot.controller.top_wheel_speed)
    if abs(share - 1.0) < LEAST_SHARE:
        return ""
    return (
        f"# Its wheels reach {share:.1%} of the speed that is commanded. Odometry sees that; a turn that is commanded\n"
        "# for a time is as much off.\n"
    )
