"""Detect wiring errors: encoders, motors or poses whose signs or sides contradict the commands."""

from collections.abc import Iterable, Sequence

import numpy as np

from cmr.estimation.estimates import EstimationError
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Times, hold

SURE = 0.5  # correlation above which a sign is trusted
LONGEST_TURN = 1.0  # rad from pose to pose; a larger one may be a jump


def require_consistent_signs(recordings: Sequence[Recording]) -> None:
    """Check the signs of wheels and poses against the commands, over all recordings together.

    Raises EstimationError with the names of signals that seem swapped or inverted. Missing or nearly constant signals
    are skipped.
    """
    commanded = [recording for recording in recordings if len(recording.duty)]
    with_wheels = [recording for recording in commanded if len(recording.wheels) > 1]
    with_poses = [recording for recording in commanded if len(recording.poses) > 1]
    if with_wheels:
        _check_wheels(with_wheels)
    if with_poses:
        _check_turns(with_poses)


def _check_wheels(recordings: list[Recording]) -> None:
    left, right = _joined(_duties(recording, recording.wheels.utime) for recording in recordings)
    psi_left, psi_right = _joined((r.wheels["psi_left"], r.wheels["psi_right"]) for r in recordings)
    for side, psi, duty in (("left", psi_left, left), ("right", psi_right, right)):
        if _agreement(psi, duty) < -SURE:
            raise EstimationError(
                f"The {side} wheel turns against its commands: its encoder counts backwards (--invert-{side} of "
                "cmr-driver), or its motor's wires are crossed."
            )
    if _agreement(psi_right - psi_left, right - left) < -SURE:
        raise EstimationError(
            "When the right wheel is commanded to be faster, the left one is: encoders or motors of the two sides are "
            "swapped (--swap of cmr-driver)."
        )


def _check_turns(recordings: list[Recording]) -> None:
    """Compare the rotation of the poses with that commanded."""
    left, right = _joined(_duties(recording, recording.poses.utime[:-1]) for recording in recordings)
    (theta,) = _joined((np.diff(recording.poses["theta"]),) for recording in recordings)
    turn = np.remainder(theta + np.pi, 2.0 * np.pi) - np.pi
    small = np.abs(turn) < LONGEST_TURN
    if _agreement(turn[small], (right - left)[small]) < -SURE:
        raise EstimationError(
            "The poses turn the other way than the commands: the tracker's y axis or heading is mirrored (headings are "
            "counter-clockwise positive, seen from above), or the motors of the two sides are swapped."
        )


def _joined(parts: Iterable[tuple[Floats, ...]]) -> list[Floats]:
    return [np.concatenate(columns) for columns in zip(*parts, strict=True)]


def _duties(recording: Recording, times: Times) -> tuple[Floats, Floats]:
    duty = recording.duty
    return hold(duty, "left", times), hold(duty, "right", times)


def _agreement(signal: Floats, command: Floats) -> float:
    """Return the cosine between two signals, from -1 to 1; 0 if one is zero."""
    size = float(np.linalg.norm(signal) * np.linalg.norm(command))
    return float(np.sum(signal * command)) / size if size > 0.0 else 0.0
