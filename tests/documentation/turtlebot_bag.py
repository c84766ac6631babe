"""The bag of a TurtleBot3 Burger's drive, with the topics that its mapping reads."""

import math
from pathlib import Path

from robot_driver.emulator.settings import Settings
from tests.support.emulated_drive import IDEAL, messages
from tests.support.ros_bags import Sent, header, write_bag

FULL_SCALE = 14.0  # rad/s of a wheel at duty 1, as the mapping has it
RADIUS, BASE_WIDTH = 0.033, 0.16  # m
TICKS = 4096


def write_turtlebot_bag(folder: Path, settings: Settings = IDEAL, *, storage: str = "sqlite") -> Path:
    """Write the bag of an emulated robot's figure-eight; return its folder."""
    sent: list[Sent] = []
    ticks_per_radian = settings.robot.ticks_per_turn / (2.0 * math.pi)
    for channel, message in messages(settings, seconds=20.0):
        stamp = message.utime * 1000
        if channel == "MOTOR_FEEDBACK_0":
            joints = {
                "name": ["wheel_left_joint", "wheel_right_joint"],
                "position": [message.ticks_left / ticks_per_radian, message.ticks_right / ticks_per_radian],
                "velocity": [message.psi_left * RADIUS, message.psi_right * RADIUS],
            }
            sent.append(("/joint_states", "sensor_msgs/msg/JointState", stamp, {"header": header(stamp), **joints}))
        elif channel == "GYRO_0":
            rate = {"z": message.yaw_rate}
            sent.append(("/imu", "sensor_msgs/msg/Imu", stamp, {"header": header(stamp), "angular_velocity": rate}))
        elif channel == "MOTOR_COMMAND_0":
            left, right = message.left * FULL_SCALE * RADIUS, message.right * FULL_SCALE * RADIUS  # m/s
            twist = {"linear": {"x": (left + right) / 2.0}, "angular": {"z": (right - left) / BASE_WIDTH}}
            sent.append(("/cmd_vel", "geometry_msgs/msg/Twist", stamp, twist))
    return write_bag(folder, storage, sent)
