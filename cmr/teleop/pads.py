"""The kernel's event devices: which one is a gamepad, the ranges of its axes, and non-blocking reads."""

import fcntl
import os
import struct
from collections.abc import Mapping
from pathlib import Path

from cmr.cli.errors import CommandError
from cmr.teleop.gamepad import ABS_X, ABS_Y, BTN_SOUTH, BTN_TRIGGER, EV_KEY, EVENT

DEVICES = Path("/dev/input")
AGAIN = 0.5  # s between two attempts to open a device that is not there
MOST_READ = 64 * EVENT.size
READ = 2 << 30  # of ioctl numbers: the caller reads
INPUT = ord("E") << 8  # and the event devices are asked
KEY_BYTES = 96  # of the set of keys of a device
AXIS = struct.Struct("6i")  # value, least, greatest, fuzz, flat, resolution
FORBIDDEN = (
    "{path}: this user may not read it. On the computer itself whoever is logged in may; over ssh the user has to be "
    "in the group input: sudo usermod -aG input $USER, then log in again."
)


class PadFile:
    """The device at `path`, or, without one, the first gamepad found; opened again when it comes back.

    Raises CommandError if the user may not read a device.
    """

    def __init__(self, path: Path | None) -> None:
        self.name = str(path or "any of /dev/input/event*")
        self.ranges: Mapping[int, tuple[int, int]] = {}
        self._path = path
        self._file: int | None = None
        self._due = float("-inf")
        self._open()

    def read(self, now: float) -> bytes | None:
        """Return the bytes received; None while the device is not there."""
        if self._file is None and now >= self._due:
            self._due = now + AGAIN
            self._open()
        if self._file is None:
            return None
        try:
            data = os.read(self._file, MOST_READ)
        except BlockingIOError:
            return b""
        except OSError:  # ENODEV: unplugged
            self.close()
            return None
        return data or None  # a pipe without a writer (yet) returns nothing

    def close(self) -> None:
        """Close the device."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _open(self) -> None:
        for path in [self._path] if self._path else sorted(DEVICES.glob("event*")):
            try:
                file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
            except PermissionError as error:
                if self._path:
                    raise CommandError(FORBIDDEN.format(path=path)) from error
                continue
            except OSError:
                continue
            if self._path or is_gamepad(file):
                self._file, self.name, self.ranges = file, str(path), ranges(file)
                return
            os.close(file)


def is_gamepad(file: int) -> bool:
    """Return whether a device has a gamepad's, or a joystick's, first button."""
    keys = _asked(file, 0x20 + EV_KEY, KEY_BYTES)
    return any(len(keys) > button // 8 and keys[button // 8] >> button % 8 & 1 for button in (BTN_SOUTH, BTN_TRIGGER))


def ranges(file: int) -> dict[int, tuple[int, int]]:
    """Return the least and the greatest value of each axis that a device reports."""
    found = {}
    for axis in (ABS_X, ABS_Y):
        answer = _asked(file, 0x40 + axis, AXIS.size)
        if len(answer) == AXIS.size:
            _, low, high, *_rest = AXIS.unpack(answer)
            if low < high:
                found[axis] = (low, high)
    return found


def _asked(file: int, number: int, size: int) -> bytes:
    """Return the answer of a device to an ioctl; empty if it is not an event device."""
    try:
        return fcntl.ioctl(file, READ | size << 16 | INPUT | number, bytes(size))
    except OSError:
        return b""
