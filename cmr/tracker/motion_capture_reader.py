"""The child process that reads frames with the package `motioncapture` and writes them to its standard output."""

import os
import pickle
import select
import signal
import sys
import time

import numpy as np

from cmr.tracker.motion_capture import LENGTH, settings_of


def main(arguments: list[str]) -> int:
    """Send frames until the parent has ended. The first argument is the type; pairs of settings follow."""
    import motioncapture

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C and ends this process
    output = os.dup(1)
    os.dup2(2, 1)  # the package prints on standard output
    try:
        tracker = motioncapture.connect(arguments[0], settings_of(arguments[1:]))
        while not select.select([0], [], [], 0.0)[0]:  # closed when the parent has ended
            tracker.waitForNextFrame()
            _send(output, time.monotonic_ns(), tracker.rigidBodies)
    except BrokenPipeError:
        return 0
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _send(output: int, arrival: int, bodies: "dict[str, object]") -> None:
    """Send a frame: length, then arrival [ns], names, and seven numbers for each body."""
    numbers = np.array([[*_position(body), *_quaternion(body)] for body in bodies.values()], float).reshape(-1, 7)
    frame = pickle.dumps((arrival, tuple(bodies), numbers.tobytes()))
    data = LENGTH.pack(len(frame)) + frame
    while data:
        data = data[os.write(output, data) :]


def _position(body: object) -> list[float]:
    return [float(value) for value in body.position]  # type: ignore[attr-defined]


def _quaternion(body: object) -> list[float]:
    turn = body.rotation  # type: ignore[attr-defined]
    return [float(turn.x), float(turn.y), float(turn.z), float(turn.w)]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
