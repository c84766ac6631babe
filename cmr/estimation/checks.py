"""Check the data before fitting: set aside unusable recordings, and correct clocks that are far off."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.estimation.estimates import EstimationError
from cmr.estimation.free_runs import LEAST, WINDOW, windows_of
from cmr.estimation.segments import LONGEST_SILENCE, SHORTEST_PIECE, Segment, segments_of
from cmr.estimation.signs import require_consistent_signs
from cmr.recordings.arrivals import NOT_FINITE
from cmr.recordings.faults.checks import CLOCK, check, lag_sentence, late_wheels_in_all
from cmr.recordings.faults.findings import Finding, Findings, counted
from cmr.recordings.faults.late_wheels import together, with_wheels_in_time
from cmr.recordings.lags import Lag, clocks_differ, lags_of, slowest_response
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS

MOST_SET_ASIDE = 0.4  # of a sensor's samples; if more are impossible, the sensor is not trusted
LARGEST_LAG = 0.5  # s; a larger offset of the poses' clock is corrected; a smaller one may be selected as an effect
LEAST_CHANGE, SURELY = 0.005, 3.0  # s, and standard deviations, by which a lag must change to indicate clock skew
# Usual lag of wheels behind their commands [s]. Corrected commands are placed slightly early, so that the remaining
# error is a delay.
USUAL_MOTOR = 0.2
SET_RIGHT = "The poses are stamped {late:.2f} s {where} than the wheels: their times were corrected."
TOO_SOON = "By its time stamps, a wheel turns {lag:.2f} s before it is commanded to"
TOO_LATE = "By its time stamps, a wheel follows its command {lag:.2f} s late"
MOVED = (
    "The commands' times were moved {by:.2f} s {where}, so that the wheels follow them after the usual {usual:.1f} s."
)
SIGNALS = {"wheels": "readings of the wheels", "poses": "poses"}
REPEATS = ("poses_held", "stale_poses")  # checks that set aside true readings that are older than their time stamps
FEWEST = 2  # readings of a sensor required to show a motion
SHORTEST = 5.0  # s; a name from less is chance
DRIVE = "Drive a figure-eight, or cmr-pilot's short_drive, and record it."
LONG_ENOUGH = f"A diagnosis takes {SHORTEST:.0f} s of driving at least; a minute of cmr-pilot's short_drive shows most."
WITHOUT_WHEELS = "Neither wheels (MOTOR_FEEDBACK_N) nor commands (MOTOR_COMMAND_N) were recorded: what drove the robot?"
WITHOUT_MOTION = (
    "Neither poses (POSE_N) nor a gyro (GYRO_N) were recorded beside the wheels: nothing shows how the robot moved."
)
NOTHING_ELSE = "Nothing else shows how the robot moved."
WITHOUT_WINDOW = (
    f"The recording has no stretch of {LEAST * WINDOW:.1f} s over which the error of {{what}} could be measured."
)
PATH, TURN = "a path (POSE_N)", "a turn (POSE_N or GYRO_N)"


@dataclass(frozen=True)
class Checked:
    """A checked recording: impossible samples removed, clock offsets corrected.

    `name` is for messages. `findings` are those of the original recording, `note` is a sentence on the changes.
    `segments` are the parts between gaps that show motion. `useless` is a sentence on why no conclusion is possible,
    empty if one is.
    """

    name: str
    recording: Recording
    findings: Findings
    note: str
    segments: tuple[Segment, ...]
    useless: str


def looked_at(
    recordings: Sequence[Recording],
    names: Sequence[str] = (),
    otherwise: str = "recording",
    wheels_late: Lag | None = None,
) -> list[Checked]:
    """Check recordings of one robot; without `names` they are numbered.

    `wheels_late` is the known latency of its wheel readings (see `check`); otherwise one value is estimated for all
    recordings.
    """
    names = list(names) or [f"{otherwise} {number + 1}" for number in range(len(recordings))]
    found = [check(recording, wheels_late) for recording in recordings]
    if wheels_late is None and len(recordings) > 1:
        late = together(one.wheels_late for one in found)
        if not any(one.lag("gyro") for one in found):
            late = late_wheels_in_all(
                [one.cleaned(one.stamped(each)) for one, each in zip(found, recordings, strict=True)]
            )
        if late is not None:
            found = [check(recording, late) for recording in recordings]
    return [
        _looked_at(recording, findings, number, name)
        for number, (recording, findings, name) in enumerate(zip(recordings, found, names, strict=True))
    ]


def _looked_at(recording: Recording, findings: Findings, number: int, name: str) -> Checked:
    recording, findings, note = with_clocks_set(recording, findings)
    cleaned = findings.cleaned(recording)
    segments = tuple(segments_of(cleaned, [int(split) for split in findings.splits], number))
    telling = tuple(segment for segment in segments if _tells(segment))
    useless = (
        "" if telling and not _untrue(recording, findings) else _why_useless(recording, cleaned, findings, segments)
    )
    return Checked(name, cleaned, findings, note, telling, useless)


def with_clocks_set(recording: Recording, findings: Findings | None = None) -> tuple[Recording, Findings, str]:
    """Return the recording with the clocks of poses and commands aligned to that of the wheels, the findings, and a
    note.

    Late or unevenly stamped wheel readings are corrected first. `findings` are those of a previous check, if there was
    one.

    The checks are made on the original recording, so that its faults are reported; they allow for a late clock. A clock
    is corrected only if it is far off, or shows an effect before its cause. Slightly late poses may be a property of
    the localisation, which the search should find; so may late commands. A clock that runs at a different rate has no
    constant lag and is left for the search to find.
    """
    findings = check(recording) if findings is None else findings
    notes = []
    recording = findings.stamped(recording)
    if findings.wheels_late is not None:
        recording = with_wheels_in_time(recording, findings.wheels_late)
    lag = findings.lag("poses")
    far_off = lag is not None and lag.reference == "wheels" and not 0.0 <= lag.seconds <= LARGEST_LAG
    if (
        lag is not None
        and far_off
        and clocks_differ(lag, findings.rates, 0.0)
        and not (abs(lag.seconds) < LARGEST_LAG and _skewed(recording))
    ):
        late = round(lag.seconds / SECONDS)
        poses = replace(recording.poses, utime=recording.poses.utime - late)
        recording, findings = replace(recording, poses=poses), replace(findings, splits=findings.splits - late)
        notes.append(SET_RIGHT.format(late=abs(lag.seconds), where="later" if late > 0 else "earlier"))
    lag = findings.lag("wheels") if recording.duty is recording.commands else None
    if lag is not None and clocks_differ(lag, findings.rates, slowest_response(recording)):
        early = round((lag.seconds - USUAL_MOTOR) / SECONDS)
        commands = replace(recording.commands, utime=recording.commands.utime + early)
        recording = replace(recording, commands=commands)
        notes.append(_commands_moved(lag.seconds, early * SECONDS))
    return recording, findings, " ".join(notes)


def _commands_moved(lag: float, by: float) -> str:
    """Return a sentence on commands that the wheels follow after `lag` [s] and whose times were moved by `by` [s]."""
    how = (TOO_SOON if lag < 0.0 else TOO_LATE).format(lag=abs(lag))
    where = "earlier" if by < 0.0 else "later"
    return f"{how}: one of the clocks is wrong. {MOVED.format(by=abs(by), where=where, usual=USUAL_MOTOR)}"


def _skewed(recording: Recording) -> bool:
    """Return whether the lag of the poses differs significantly between the two halves of a recording."""
    first, last = int(recording.wheels.utime[0]), int(recording.wheels.utime[-1])
    middle = (first + last) // 2
    halves = [recording.between(first, middle), recording.between(middle, last)]
    lags = [lag for half in halves for lag in lags_of(half) if lag.sensor == "poses" and lag.known]
    if len(lags) < len(halves):
        return False
    change, doubt = lags[1].seconds - lags[0].seconds, float(np.hypot(lags[0].std, lags[1].std))
    return abs(change) > max(LEAST_CHANGE, SURELY * doubt)


def _tells(segment: Segment) -> bool:
    """Return whether a segment contains both the robot's input and its motion."""
    observations = segment.observations
    return (
        max(len(observations.wheel_time), len(observations.commands.time)) >= FEWEST
        and max(len(observations.pose_time), len(observations.gyro_time)) >= FEWEST
    )


def _untrue(recording: Recording, findings: Findings) -> str:
    """Return which sensor cannot be trusted; empty if none."""
    for name, words in SIGNALS.items():
        signal = recording.signals[name]
        empty = signal.left_out.get(NOT_FINITE, 0)
        repeated = _set_aside(findings, name, REPEATS)
        others = [finding.check for finding in findings.all if finding.check not in REPEATS]
        lost, total = _set_aside(findings, name, others) + empty, len(signal) - repeated + empty
        if lost > MOST_SET_ASIDE * total:
            why = "cannot be true" + (f" ({empty} are not numbers)" if empty else "")
            return f"Of the {words}, {lost} of {total} {why}: check the sensor first. No result is given."
    return ""


def _set_aside(findings: Findings, signal: str, checks: Sequence[str]) -> int:
    """Return how many samples of a signal these checks set aside."""
    masks = [findings[check].set_aside[signal] for check in checks if signal in findings[check].set_aside]
    return int(sum(masks[1:], start=masks[0]).astype(bool).sum()) if masks else 0


def _why_set_aside(findings: Findings, signal: str) -> list[str]:
    """Return why samples of a signal are not used, a sentence each."""
    return [finding.sentence for finding in findings.all if signal in finding.set_aside]


def _why_useless(recording: Recording, cleaned: Recording, findings: Findings, segments: Sequence[Segment]) -> str:
    """Return why a recording is useless, and what to do."""
    if max(len(recording.wheels), len(recording.commands)) < FEWEST:
        return WITHOUT_WHEELS
    untrue = _untrue(recording, findings)
    if untrue:
        return untrue
    if segments or max(len(cleaned.poses), len(cleaned.gyro)) < FEWEST:
        return _why_no_motion(recording, cleaned, findings)
    drives = [(name, signal) for name, signal in (("wheels", recording.wheels), ("commands", recording.duty)) if signal]
    seconds = max(float(signal.seconds[-1]) for _, signal in drives)
    if seconds < SHORTEST:
        return f"The recording is too short: it lasts {seconds:.1f} s. {LONG_ENOUGH}"
    names = " and ".join(name for name, _ in drives)
    return (
        f"In no stretch of {SHORTEST_PIECE:.0f} s were {names} recorded without a gap of more than "
        f"{LONGEST_SILENCE:.0f} s. {LONG_ENOUGH}"
    )


def _why_no_motion(recording: Recording, cleaned: Recording, findings: Findings) -> str:
    """Return why a recording does not show how the robot moved."""
    lost = [name for name in ("poses", "gyro") if len(cleaned.signals[name]) < FEWEST]
    set_aside = [sentence for name in lost for sentence in _why_set_aside(findings, name)]
    if set_aside:
        return " ".join([*set_aside, NOTHING_ELSE])
    recorded = {"pose": len(recording.poses), "gyro reading": len(recording.gyro)}
    if not any(recorded.values()):
        return WITHOUT_MOTION
    return (
        f"{' and '.join(counted(count, what) for what, count in recorded.items() if count)} were recorded, but no "
        f"stretch with known wheels or commands has {FEWEST} of them or more: nothing shows how the robot moved there."
    )


def refusal(looked: Sequence[Checked], shortest: float = SHORTEST) -> str:
    """Return why the recordings cannot be diagnosed, in a sentence that says what to do; empty if they can.

    Less than `shortest` [s] in all is too short.
    """
    usable = [one for one in looked if not one.useless]
    if all(one.findings["never_moved"].found for one in looked):
        return f"The robot never moves in these recordings. {DRIVE}"
    if not usable:
        return looked[0].useless if len(looked) == 1 else " ".join(f"{one.name}: {one.useless}" for one in looked)
    seconds = sum(segment.observations.seconds for one in usable for segment in one.segments)
    if seconds < shortest:
        return f"Too little was recorded: {seconds:.1f} s of use. {LONG_ENOUGH}"
    return _crossed(usable)


def _crossed(looked: Sequence[Checked]) -> str:
    """Return a sentence on wires or axes that seem to be swapped; empty if none."""
    try:
        require_consistent_signs([one.recording for one in looked])
    except EstimationError as error:
        return str(error)
    return ""


def require_of_use_held_out(looked: Sequence[Checked], *, path: bool) -> None:
    """Make sure that the gain can be measured on these recordings, in path error if there is a `path`.

    Raises EstimationError with the names of unsuitable recordings and the reasons.
    """
    lacking = WITHOUT_WINDOW.format(what=PATH if path else TURN)
    reasons = {one.name: one.useless or ("" if _has_window(one, path) else lacking) for one in looked}
    wrong = [f"{name} cannot be held out: {reason}" for name, reason in reasons.items() if reason]
    crossed = "" if wrong else _crossed(looked)
    if crossed:
        wrong = [f"{', '.join(reasons)} cannot be held out: {crossed}"]
    if wrong:
        raise EstimationError(" ".join([*wrong, "Leave it out, or hold another log out."]))


def _has_window(looked: Checked, path: bool) -> bool:
    """Return whether there is a window for free runs; with `path`, one with poses."""
    observations = [segment.observations for segment in looked.segments]
    return any(len(windows_of(one, WINDOW).begin) for one in observations if len(one.pose) or not path)


def with_lags_found(looked: Sequence[Checked], found: Sequence[Lag]) -> list[Checked]:
    """Return recordings whose clock checks state the lags to the wheels `found` with the model.

    Two sensors alone determine a lag less accurately. If times were corrected, the checks of the original recording
    stay.
    """
    return [one if one.note else replace(one, findings=_with_lags(one.findings, found)) for one in looked]


def _with_lags(findings: Findings, found: Sequence[Lag]) -> Findings:
    before = {lag.sensor for lag in findings.lags if lag.known and lag.reference == "wheels"}
    sentences = {CLOCK[lag.sensor]: lag_sentence(lag.sensor, lag) for lag in found if lag.sensor in before}
    said = (replace(one, sentence=sentences.get(one.check, one.sentence)) for one in findings.all)
    return replace(findings, all=tuple(said))


def findings_of(looked: Sequence[Checked]) -> tuple[Finding, ...]:
    """Return the findings of the checks; with several recordings, each sentence names its recording.

    A check without a finding in any of them is listed once.
    """
    if len(looked) == 1:
        return looked[0].findings.all
    found = [
        replace(finding, sentence=f"{one.name}: {finding.sentence}")
        for one in looked
        for finding in one.findings.all
        if finding.found
    ]
    already = {finding.check for finding in found}
    return (*found, *(finding for finding in looked[0].findings.all if finding.check not in already))


def notes_of(looked: Sequence[Checked]) -> tuple[str, ...]:
    """Return sentences on the changes to recordings, and on those that were set aside."""
    if len(looked) == 1:
        return (looked[0].note,) if looked[0].note else ()
    set_aside = [f"{one.name} is set aside. {one.useless}" for one in looked if one.useless]
    return (*set_aside, *(f"{one.name}: {one.note}" for one in looked if one.note and not one.useless))
