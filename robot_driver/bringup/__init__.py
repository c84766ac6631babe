"""Brings up a new robot: finds devices, wiring, encoders, gyro and poses together with a person, and writes settings."""

from robot_driver.bringup.bench import Bench, CannotTell, World
from robot_driver.bringup.known import Known, driver_arguments, load
from robot_driver.bringup.procedure import STEPS, Place, Procedure, Result

__all__ = ["STEPS", "Bench", "CannotTell", "Known", "Place", "Procedure", "Result", "World", "driver_arguments", "load"]
