"""Trackers supported by the package `motioncapture` (libmotioncapture): Vicon, Motion Analysis and its own mock.

The package blocks with Python's lock held until a frame arrives, possibly for ever, and provides no time stamps. So it
runs in a child process, which sends each frame through a pipe, stamped with its arrival. NOKOV and FZMotion are only in
builds of one's own, as their makers' libraries may not be redistributed.
"""

import os
import pickle
import signal
import struct
import subprocess
import sys
from importlib.util import find_spec

import numpy as np

from cmr.tracker.frames import Sample
from cmr.tracker.profile import Tracker
from cmr.tracker.source import Clock, SourceError

OWN_BUILD = ("nokov", "fzmotion")
LENGTH = struct.Struct("<I")
LONGEST_ANSWER = 4096  # characters of an error
MOCK = "robot_0(0.5,0,0.1,1,0,0,0);robot_1(-0.5,0,0.1,1,0,0,0)"
RESTART = 2.0  # s after which a process that ended is started again


class MotionCapture:
    """A tracker behind the package `motioncapture`, whose frames are stamped on arrival only."""

    uncertainty = "the whole time from the exposure to the arrival, beyond the profile's lag: this package reports none"

    def __init__(self, tracker: Tracker, clock: Clock) -> None:
        if find_spec("motioncapture") is None:
            raise ModuleNotFoundError("No module named 'motioncapture'", name="motioncapture")
        self.problem = f"No frame from the {tracker.type} at {tracker.server} yet."
        self._tracker, self._clock = tracker, clock
        self._waiting = b""
        self._child: subprocess.Popen[bytes] | None = None
        self._ended = -1e9
        self._start()

    def filenos(self) -> list[int]:
        """Return the pipe to wait on."""
        return [] if self._child is None or self._child.stdout is None else [self._child.stdout.fileno()]

    def read(self) -> list[Sample]:
        """Return the frames received."""
        assert self._child is not None
        assert self._child.stdout is not None
        try:
            data = os.read(self._child.stdout.fileno(), 1 << 20)
        except BlockingIOError:
            return []
        if not data:
            self._end()
            return []
        self._waiting += data
        samples = []
        while len(self._waiting) >= LENGTH.size:
            end = LENGTH.size + LENGTH.unpack_from(self._waiting)[0]
            if len(self._waiting) < end:
                break
            arrival, names, numbers = pickle.loads(self._waiting[LENGTH.size : end])  # of our own child
            self._waiting = self._waiting[end:]
            poses = np.frombuffer(numbers).reshape(-1, 7)
            origin = f"{self._tracker.type} {self._tracker.server}"
            samples.append(Sample(arrival, None, None, names, poses[:, :3], poses[:, 3:], origin))
        if samples:
            self.problem = ""
        return samples

    def tend(self, now: float) -> None:
        """Restart the process if it has ended."""
        if self._child is None and now - self._ended > RESTART:
            self._start()

    def close(self) -> None:
        """End the process."""
        if self._child is not None:
            self._child.send_signal(signal.SIGKILL)  # it may be waiting for a frame inside the package
            self._child.communicate()
            self._child = None

    def _start(self) -> None:
        tracker = self._tracker
        settings = {"hostname": tracker.server, "interface_ip": tracker.local, "frequency": str(tracker.rate)}
        if tracker.type == "mock":
            settings["rigid_bodies"] = MOCK
        arguments = [word for pair in settings.items() for word in pair]
        self._waiting = b""
        self._child = subprocess.Popen(
            [sys.executable, "-m", "cmr.tracker.motion_capture_reader", tracker.type, *arguments],
            stdin=subprocess.PIPE,  # the child ends when it is closed
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        assert self._child.stdout is not None
        os.set_blocking(self._child.stdout.fileno(), False)

    def _end(self) -> None:
        """Record that the process has ended, and why. Raises SourceError if a restart would not help."""
        assert self._child is not None
        _, errors = self._child.communicate()
        self._child, self._ended = None, self._clock() / 1e9
        lines = errors.decode(errors="replace").strip()[-LONGEST_ANSWER:].splitlines()
        why = lines[-1] if lines else "it ended without a word"
        if "Unknown motion capture type" in why:
            raise SourceError(_not_built(self._tracker.type))
        self.problem = f"The package motioncapture cannot read the {self._tracker.type}: {why}"


def _not_built(kind: str) -> str:
    """Return advice for a type that this build of the package lacks."""
    if kind in OWN_BUILD:
        return (
            f"The published package motioncapture lacks {kind}, because its maker's library may not be passed on. "
            "Build libmotioncapture with it (github.com/IMRCLab/libmotioncapture), or switch the tracker's VRPN server "
            "on and use the type vrpn."
        )
    return f"This build of the package motioncapture does not know the type {kind}."


def settings_of(words: list[str]) -> dict[str, str]:
    """Return the settings given as alternating keys and values."""
    return dict(zip(words[::2], words[1::2], strict=True))
