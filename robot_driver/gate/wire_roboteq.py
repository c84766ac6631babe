"""Roboteq controllers, for the last gate: the lines that the driver sends, each with a carriage return."""

import re

from robot_driver.gate.wire import Request, Stop

END = b"\r"
DONE = b"+\r"
FULL_DUTY = 1000
LONGEST_WATCHDOG = 500  # ms

_DRIVE = re.compile(rb"!M (-?\d{1,4}) (-?\d{1,4})\r")
_SET_WATCHDOG = re.compile(rb"\^RWD (\d{1,3})\r")
_OTHER = re.compile(rb"(\^ECHOF 1|[?~][A-Z]{1,4}( \d)?)\r")  # no echo; queries of readings and of settings


class RoboteqWire:
    """One Roboteq with two channels."""

    units = 1
    streams = False

    def read(self, data: bytes) -> list[Request] | None:
        """Return the one request in a line."""
        if drive := _DRIVE.fullmatch(data):
            return [Request((int(drive[1]) / FULL_DUTY, int(drive[2]) / FULL_DUTY))]
        if watchdog := _SET_WATCHDOG.fullmatch(data):
            return [Request(arms=1)] if 0 < int(watchdog[1]) <= LONGEST_WATCHDOG else None
        return [Request()] if _OTHER.fullmatch(data) else None

    def stops(self, now: int) -> list[Stop]:
        """Stop both channels; before the answer the device may repeat the line."""
        del now
        zero = b"!M 0 0\r"
        return [Stop(zero, lambda reply: reply.removeprefix(zero) == DONE)]
