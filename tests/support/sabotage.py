"""Drivers that break their promises on purpose, each in one way; for tests of the acceptance protocol alone."""

import re

from robot_driver import serial_port
from tests.support.accepted_robot import NUMBERED


def start(broken: str) -> int:
    """Start cmr-driver, broken in this way, if in any."""
    from cmr.commands import driver

    serial_port.NUMBERED = re.compile(NUMBERED)
    if broken:
        BROKEN[broken]()
    return driver()


BROKEN = {}
