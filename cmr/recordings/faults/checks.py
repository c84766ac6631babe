"""Check a recording before it is used; everything that is excluded is reported.

It needs no parameters of the robot, and only NumPy, so a calibration can start with it at once.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from cmr.recordings.faults.commands_in_force import commands_in_force
from cmr.recordings.faults.findings import Finding, Findings, counted
from cmr.recordings.faults.gyro_checks import gyro_findings
from cmr.recordings.faults.heading_checks import turned_headings
from cmr.recordings.faults.held_poses import held_poses
from cmr.recordings.faults.joining import one_after_another
from cmr.recordings.faults.late_wheels import IN_TIME, late_wheels, with_wheels_in_time
from cmr.recordings.faults.path_faults import PathFaults, path_faults
from cmr.recordings.faults.stale_poses import stale_poses
from cmr.recordings.faults.time_checks import damaged_samples, gap_findings, held_up_finding, log_findings, rates_of
from cmr.recordings.faults.uneven_stamps import EvenStamps, even_stamps
from cmr.recordings.faults.wheel_checks import dead_sensors, motion_findings, wheel_findings
from cmr.recordings.lags import Lag, clocks_differ, is_ahead, lags_of, slowest_response
from cmr.recordings.recording import Recording

__all__ = ["Finding", "Findings", "check"]

CLOCK = {"poses": "poses_clock", "gyro": "gyro_clock"}  # the check of each sensor's clock


def check(recording: Recording, wheels_late: Lag | None = None) -> Findings:
    """Check a recording: poses, wheels, clocks, gaps and the log itself.

    The latency of the wheels is estimated, unless it is known from other recordings of the robot: `wheels_late`,
    late_wheels.IN_TIME if they are not late.
    """
    even = even_stamps(recording)
    for stamps in even:
        recording = stamps.of(recording)
    damaged = damaged_samples(recording)
    stale = _over_all(stale_poses(_without(recording, [damaged])), [damaged], recording)
    sound = _without(recording, [damaged, stale])
    sensors = [*wheel_findings(sound), dead_sensors(sound)]
    plausible = _without(sound, sensors)
    in_force = commands_in_force(plausible, rates_of(sound))
    plausible = _without(plausible, [in_force])
    gyro = gyro_findings(plausible)
    plausible = _without(plausible, gyro)
    lags, rates = _lags_without_repeats(plausible), rates_of(sound)
    late = _late(plausible, lags, rates) if wheels_late is None else wheels_late
    late = None if late == IN_TIME else late
    if late is not None:  # everything else is compared with wheels with corrected stamps
        plausible = with_wheels_in_time(plausible, late)
        lags = _lags_without_repeats(plausible)
    pose_lag, gyro_lag = _pose_and_gyro_lag(lags)
    faults = path_faults(plausible, pose_lag, gyro_lag)
    turned = turned_headings(plausible, faults, pose_lag)
    findings = [*_pose_findings(faults), turned, *sensors, *gyro, in_force]
    findings = [_over_all(finding, [damaged, stale], recording) for finding in findings]
    findings += [
        damaged,
        stale,
        _stamps_finding(even),
        _wheels_finding(late),
        *_lag_findings(lags, rates, slowest_response(recording)),
    ]
    findings += motion_findings(sound)
    findings += [*gap_findings(sound), held_up_finding(sound), *log_findings(sound)]
    begins = faults.jumps | sound.pieces.borders(sound.poses.utime)
    return Findings(tuple(findings), sound.poses.utime[begins], tuple(lags), rates, late, tuple(even))


def late_wheels_in_all(recordings: Sequence[Recording]) -> Lag | None:
    """Return the latency of the wheels of one robot, from all its recordings at once; None if they need not be late.

    Many short recordings together determine what none of them does.
    """
    joined = one_after_another(recordings)
    return _late(joined, lags_of(joined), rates_of(joined))


def _late(recording: Recording, lags: list[Lag], rates: Mapping[str, float]) -> Lag | None:
    """Return the latency of the wheels, if the gyro is significantly ahead of them."""
    gyro = next((lag for lag in lags if lag.sensor == "gyro"), None)
    return late_wheels(recording, lags) if gyro is not None and is_ahead(gyro, rates) else None


def _lags_without_repeats(recording: Recording) -> list[Lag]:
    """Return the lags of the sensors; repeated poses are old, and are skipped."""
    lags = lags_of(recording)
    held = held_poses(recording, _pose_and_gyro_lag(lags)[0])
    return lags_of(recording.where({"poses": ~held})) if held.any() else lags


def _pose_and_gyro_lag(lags: list[Lag]) -> tuple[float, float]:
    """Return the lags [s] of poses and gyro behind their reference.

    If one is unknown, the two are assumed to agree when compared with commands, which both follow as slowly as the
    robot does, and sensors are assumed to agree with the wheels.
    """
    known = {lag.sensor: lag.seconds for lag in lags if lag.known and lag.sensor != "wheels"}
    commanded = any(lag.reference == "commands" for lag in lags if lag.sensor != "wheels")
    usual = next(iter(known.values()), 0.0) if commanded else 0.0
    return known.get("poses", usual), known.get("gyro", usual)


def _without(recording: Recording, found: list[Finding]) -> Recording:
    """Return the recording without the samples excluded by these findings."""
    return Findings(tuple(found), np.empty(0, np.int64), (), {}).cleaned(recording)


def _over_all(finding: Finding, before: list[Finding], recording: Recording) -> Finding:
    """Convert a finding on the remaining samples to one on all samples."""
    spread_out = {}
    for name, mask in finding.set_aside.items():
        whole = np.zeros(len(recording.signals[name]), np.bool_)
        gone = [one.set_aside[name] for one in before if name in one.set_aside]
        whole[~np.any(gone, axis=0) if gone else slice(None)] = mask
        spread_out[name] = whole
    return Finding(finding.check, finding.found, finding.sentence, spread_out)


def _pose_findings(faults: PathFaults) -> list[Finding]:
    outliers, held, jumps = (int(np.count_nonzero(mask)) for mask in (faults.outliers, faults.held, faults.jumps))
    return [
        Finding(
            "pose_outliers",
            outliers,
            f"{counted(outliers, 'pose')} of {len(faults.outliers)} are inconsistent with the others (noise is "
            f"{1000 * faults.position_noise:.1f} mm and {np.degrees(faults.heading_noise):.2f} degrees): set aside.",
            {"poses": faults.outliers} if outliers else {},
        ),
        Finding(
            "pose_jumps", jumps, f"The tracker jumps {counted(jumps, 'time')}: the path is cut there and starts again."
        ),
        Finding(
            "poses_held",
            held,
            f"{counted(held, 'pose')} of {len(faults.held)} only repeat{'s' if held == 1 else ''} the one before while "
            "the robot moves: set aside.",
            {"poses": faults.held} if held else {},
        ),
    ]


def _stamps_finding(even: Sequence[EvenStamps]) -> Finding:
    together: dict[float, list[str]] = {}
    for one in even:
        together.setdefault(one.jitter, []).append(one.signal)
    uneven = ", ".join(f"the {' and the '.join(names)} by {1000 * jitter:.1f} ms" for jitter, names in together.items())
    return Finding(
        "uneven_stamps",
        len(even),
        f"What was taken at even intervals is stamped unevenly: {uneven} (standard deviation). The stamps were evened "
        "out.",
    )


def _wheels_finding(late: Lag | None) -> Finding:
    sentence = "The wheels are not reported later than the gyro."
    if late is not None:
        sentence = (
            f"The wheels report {late.seconds:.3f} +- {late.std:.3f} s late beside the {late.reference}: they are "
            f"filtered or stamped late, or the clock of the {late.reference} is behind. Their times were corrected."
        )
    return Finding("wheels_late", int(late is not None), sentence)


def _lag_findings(lags: list[Lag], rates: Mapping[str, float], slowest: float) -> list[Finding]:
    """Report clock offsets; a lag of wheels behind commands is normal for motors."""
    findings = []
    for sensor in CLOCK:
        lag = next((lag for lag in lags if lag.sensor == sensor), None)
        differs = lag is not None and clocks_differ(lag, rates, slowest)
        findings.append(Finding(CLOCK[sensor], int(differs), lag_sentence(sensor, lag)))
    return findings


def lag_sentence(sensor: str, lag: Lag | None) -> str:
    """Describe the offset of the clock of poses or gyro from that of its reference."""
    subject = "The poses'" if sensor == "poses" else "The gyro's"
    if lag is None:
        return f"{subject} clock has nothing to be compared with."
    if not lag.known:
        return f"{subject} clock cannot be compared with that of the {lag.reference}: {lag.why_unknown}."
    if lag.reference == "commands":
        return f"{subject} motion comes {lag.seconds:.3f} +- {lag.std:.3f} s after the commands, motors included."
    stamped, it_is, whose = (
        ("The poses are", "they come", "their") if sensor == "poses" else ("The gyro is", "it comes", "its")
    )
    size = f"{abs(lag.seconds):.3f} +- {lag.std:.3f} s"
    if lag.seconds > 0.0:
        return f"{stamped} stamped {size} later than the {lag.reference}: {it_is} late, or {whose} clock is ahead."
    reason = f"{whose} clock is behind, or the {lag.reference} come late"
    return f"{stamped} stamped {size} earlier than the {lag.reference}: {reason}."
