"""Look at the data before the robot: refuse what cannot be judged, and set right a clock that is far off."""

from collections.abc import Sequence
from dataclasses import replace

from cmr.calibration.result import CalibrationError
from cmr.calibration.signs import require_consistent_signs
from cmr.recordings.checks import check
from cmr.recordings.findings import Findings
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS

MOST_SET_ASIDE = 0.4  # of a sensor's samples; if more cannot be true, none can be trusted
LARGEST_LAG = 0.35  # s; a pose's clock that is further off is moved, a smaller difference may be named
SIGNALS = {"wheels": "readings of the wheels", "poses": "poses"}


def refusal(recordings: Sequence[Recording], findings: Sequence[Findings]) -> str:
    """Return why the recordings cannot be diagnosed, in a sentence that says what to do; empty if they can."""
    if all(one["never_moved"].found for one in findings):
        return (
            "The robot never moves in these recordings. Drive a figure-eight, or cmr-pilot's rich_drive, and record it."
        )
    heard = {name for recording in recordings for name, signal in recording.signals.items() if len(signal)}
    if "wheels" not in heard:
        return "No wheels were recorded (MOTOR_FEEDBACK_N): they are needed to tell the motors from the floor."
    if not heard & {"poses", "gyro"}:
        return "Neither poses (POSE_N) nor a gyro (GYRO_N) were recorded: nothing tells how the robot moved."
    for name, words in SIGNALS.items():
        lost = sum(_set_aside(one, name) for one in findings)
        total = sum(len(recording.signals[name]) for recording in recordings)
        if lost > MOST_SET_ASIDE * total:
            return f"Of the {words}, {lost} of {total} cannot be true: see to the sensor first. Nothing is concluded."
    try:
        require_consistent_signs(list(recordings))
    except CalibrationError as error:
        return str(error)
    return ""


def _set_aside(findings: Findings, signal: str) -> int:
    masks = [finding.set_aside[signal] for finding in findings.all if signal in finding.set_aside]
    return int(sum(masks[1:], start=masks[0]).astype(bool).sum()) if masks else 0


def with_clocks_set(recording: Recording) -> tuple[Recording, Findings, str]:
    """Return the recording with the clock of its poses set by that of the wheels, what the checks found, and a note.

    Only a clock that is far off is touched. A pose that is a little late may be the fault of the localisation, and is
    then a finding about it.
    """
    findings = check(recording)
    lag = findings.lag("poses")
    if lag is None or lag.reference != "wheels" or abs(lag.seconds) <= LARGEST_LAG:
        return recording, findings, ""
    poses = replace(recording.poses, utime=recording.poses.utime - round(lag.seconds / SECONDS))
    moved = replace(recording, poses=poses)
    where = "behind" if lag.seconds > 0.0 else "ahead of"
    note = f"The poses' clock is {abs(lag.seconds):.2f} s {where} that of the wheels: their times were set right."
    return moved, check(moved), note
