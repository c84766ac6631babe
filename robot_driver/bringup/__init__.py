"""Bring up a new robot: find devices, wiring, encoders, gyro and poses together with a person, and write settings."""

from robot_driver.bringup.bench import Bench, CannotTell, Drivable, World
from robot_driver.bringup.known import Known, load
from robot_driver.bringup.procedure import STEPS, Place, Procedure, Result

__all__ = ["STEPS", "Bench", "CannotTell", "Drivable", "Known", "Place", "Procedure", "Result", "World", "load"]
