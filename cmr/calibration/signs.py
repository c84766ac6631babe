"""Find wires that are crossed: encoders, motors or poses whose signs or sides contradict the commands."""

from collections.abc import Sequence

import numpy as np

from cmr.calibration.result import CalibrationError
from cmr.calibration.segments import hold
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Times

SURE = 0.5  # correlation from which on a sign is believed
LONGEST_TURN = 1.0  # rad from pose to pose; a larger one may be a jump


def require_consistent_signs(recordings: Sequence[Recording]) -> None:
    """Check which way wheels and poses go against the commands.

    Raises CalibrationError that names what seems to be crossed. What is not recorded, or hardly varies, is passed.
    """
    for recording in recordings:
        if len(recording.duty) and len(recording.wheels) > 1:
            _check_wheels(recording)
        if len(recording.duty) and len(recording.poses) > 1:
            _check_turns(recording)


def _check_wheels(recording: Recording) -> None:
    left, right = _duties(recording, recording.wheels.utime)
    psi_left, psi_right = recording.wheels["psi_left"], recording.wheels["psi_right"]
    for side, psi, duty in (("left", psi_left, left), ("right", psi_right, right)):
        if _agreement(psi, duty) < -SURE:
            raise CalibrationError(
                f"The {side} wheel turns against its commands: its encoder counts backwards (--invert-{side} of "
                "cmr-driver), or its motor's wires are crossed."
            )
    if _agreement(psi_right - psi_left, right - left) < -SURE:
        raise CalibrationError(
            "When the right wheel is commanded to be faster, the left one is: encoders or motors of the two sides are "
            "swapped (--swap of cmr-driver)."
        )


def _check_turns(recording: Recording) -> None:
    """Compare the turns of the poses with those that were commanded."""
    poses = recording.poses
    turn = np.remainder(np.diff(poses["theta"]) + np.pi, 2.0 * np.pi) - np.pi
    left, right = _duties(recording, poses.utime[:-1])
    small = np.abs(turn) < LONGEST_TURN
    if _agreement(turn[small], (right - left)[small]) < -SURE:
        raise CalibrationError(
            "The poses turn the other way than the commands: the tracker's y axis or heading is mirrored (headings are "
            "counter-clockwise positive, seen from above), or the motors of the two sides are swapped."
        )


def _duties(recording: Recording, times: Times) -> tuple[Floats, Floats]:
    duty = recording.duty
    return hold(duty, "left", times), hold(duty, "right", times)


def _agreement(signal: Floats, command: Floats) -> float:
    """Return the cosine between two signals, from -1 to 1; 0 where one does nothing."""
    size = float(np.linalg.norm(signal) * np.linalg.norm(command))
    return float(np.sum(signal * command)) / size if size > 0.0 else 0.0
