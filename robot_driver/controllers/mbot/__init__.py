"""The control board of the University of Michigan's MBot: wheels and gyro on one port."""

from robot_driver.controllers.mbot.board import MBot
from robot_driver.controllers.mbot.gyro import MBotGyro

__all__ = ["MBot", "MBotGyro"]
