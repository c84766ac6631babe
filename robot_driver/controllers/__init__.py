"""Motor controllers: one module per protocol, bytes in and readings out, and the table of those we know.

A new controller is one module with a subclass of `Controller` and one entry in `CONTROLLERS`.
"""

from robot_driver.controllers.controller import BadReply, Controller, Request, Telemetry, conditions_of
from robot_driver.controllers.mbot import MBot
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.controllers.roboclaw_pair import RoboClawPair
from robot_driver.controllers.roboteq import Roboteq

CONTROLLERS: dict[str, type[Controller]] = {
    "mbot": MBot,
    "roboclaw": RoboClaw,
    "roboclaw-pair": RoboClawPair,
    "roboteq": Roboteq,
}

__all__ = ["CONTROLLERS", "BadReply", "Controller", "Request", "Telemetry", "conditions_of"]
