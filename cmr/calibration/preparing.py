"""Prepare recordings for fitting: remove impossible data, and report it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.calibration.segments import Segment, segments_of
from cmr.recordings.faults.checks import check
from cmr.recordings.faults.findings import Findings
from cmr.recordings.lags import Lag, clocks_differ, slowest_response
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Signal

UNKNOWN_CLOCK_STD, SERIAL_LINE_STD = 0.1, 1e-3  # s
USUAL_MOTOR = 0.15  # s that wheels lag their commands
# Findings of data checks that are reported although nothing was removed.
REPORTED = ("pose_jumps", "uneven_stamps", "gaps", "unusable_messages", "rejected_messages", "damaged_log")
LEAST_LAG = 0.02  # s; the refinement finds a smaller one itself
LAG_MARGIN, LEAST_CLOCK_STD = 3.0, 2e-3  # standard deviations of the lag; s


@dataclass(frozen=True)
class Prepared:
    """Recordings without impossible data; `splits` are the utimes [us] at which each path jumps.

    `notes` are sentences on what was removed, `pose_clock_std` [s] is the uncertainty of the offset between the clocks
    of wheels and poses. `commands_shifted` and `poses_shifted` [s] are the largest corrections of stamps.
    """

    recordings: list[Recording]
    splits: list[tuple[int, ...]]
    notes: tuple[str, ...] = ()
    pose_clock_std: float = UNKNOWN_CLOCK_STD
    commands_shifted: float = 0.0
    poses_shifted: float = 0.0

    @property
    def command_clock_std(self) -> float:
        """The standard deviation of the time at which a command takes effect [s].

        Duties reported by the driver have the wheels' clock, and are off by no more than a serial line takes. Other
        commands may have any clock; without wheels, a wrong clock could not be told from a slow motor.
        """
        own_clock = [len(r.wheels) > 1 and r.duty is r.commands for r in self.recordings]
        return UNKNOWN_CLOCK_STD if all(own_clock) else SERIAL_LINE_STD

    def segments(self) -> list[Segment]:
        """Return the segments of all recordings."""
        pairs = zip(self.recordings, self.splits, strict=True)
        return [segment for recording, splits in pairs for segment in segments_of(recording, splits)]

    def shifted(self, commands: float = 0.0, poses: float = 0.0) -> "Prepared":
        """Return the same with the stamps of commands and poses shifted by these times [s]."""
        late, moved = round(commands / SECONDS), round(poses / SECONDS)
        return replace(
            self,
            recordings=[_shifted(recording, late, moved) for recording in self.recordings],
            splits=[tuple(split + moved for split in splits) for splits in self.splits],
            commands_shifted=self.commands_shifted + commands,
            poses_shifted=self.poses_shifted + poses,
        )


def prepare(recordings: Sequence[Recording]) -> Prepared:
    """Check the recordings, remove impossible data, and align clocks that are far off with that of the wheels."""
    ready, splits, notes, moved, doubts = [], [], [], [], []
    for recording in recordings:
        findings = check(recording)
        recording = findings.stamped(recording)
        poses, commands = _pose_lag(findings), _command_lag(findings, recording)
        late = poses.seconds if poses and abs(poses.seconds) > LEAST_LAG else 0.0
        # A command that moves the wheels before it is sent, or long after, was stamped by a different clock.
        wrong = commands and clocks_differ(commands, findings.rates, slowest_response(recording))
        early = commands.seconds - USUAL_MOTOR if commands and wrong else 0.0
        ready.append(_shifted(findings.cleaned(recording), round(early / SECONDS), -round(late / SECONDS)))
        splits.append(tuple(int(split) - round(late / SECONDS) for split in findings.splits))
        notes += [f.sentence for f in findings.all if f.found and (f.check in REPORTED or f.set_aside)]
        moved.append((early, -late))
        doubts.append(max(LAG_MARGIN * poses.std, LEAST_CLOCK_STD) if poses else UNKNOWN_CLOCK_STD)
    furthest = [max(column, key=abs) for column in zip(*moved, strict=True)]
    return Prepared(ready, splits, tuple(dict.fromkeys(notes)), max(doubts), *furthest)


def _pose_lag(findings: Findings) -> Lag | None:
    """Return the lag of poses behind the wheels; compared with commands, a slow motor would look like late poses."""
    lag = findings.lag("poses")
    return lag if lag is not None and lag.reference == "wheels" else None


def _command_lag(findings: Findings, recording: Recording) -> Lag | None:
    """Return the lag of the wheels behind the commands; None if the feedback contains the applied duties."""
    return findings.lag("wheels") if recording.duty is recording.commands else None


def _shifted(recording: Recording, commands: int, poses: int) -> Recording:
    """Return the recording with the stamps of commands and poses shifted by these times [us]."""
    if commands:
        # The applied duties are in the wheels' messages; as separate commands they can have a different clock.
        duty = recording.duty
        unknown = np.full(len(recording.wheels), np.nan)
        fields = recording.wheels.fields | {"applied_left": unknown, "applied_right": unknown}
        recording = replace(recording, commands=_moved(duty, commands), wheels=replace(recording.wheels, fields=fields))
    return replace(recording, poses=_moved(recording.poses, poses))


def _moved(signal: Signal, time: int) -> Signal:
    return replace(signal, utime=signal.utime + time)
