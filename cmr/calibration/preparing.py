"""Make recordings ready to be fitted: set aside what cannot be true, and say so."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.calibration.segments import Segment, segments_of
from cmr.recordings.checks import check
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Signal

UNKNOWN_CLOCK_STD = 0.1  # s
LEAST_LAG = 0.02  # s; the refinement finds a smaller one itself
LAG_MARGIN, LEAST_CLOCK_STD = 3.0, 2e-3  # standard deviations of the lag; s


@dataclass(frozen=True)
class Prepared:
    """Recordings without what cannot be true; `splits` are the utimes [us] at which each one's path jumps.

    `notes` are sentences on what was set aside, `pose_clock_std` [s] tells how well the clocks of wheels and poses are
    known to agree. `commands_shifted` and `poses_shifted` [s] tell by how much the stamps
    were moved.
    """

    recordings: list[Recording]
    splits: list[tuple[int, ...]]
    notes: tuple[str, ...] = ()
    pose_clock_std: float = UNKNOWN_CLOCK_STD
    commands_shifted: float = 0.0
    poses_shifted: float = 0.0

    def segments(self) -> list[Segment]:
        """Return the segments of all recordings."""
        pairs = zip(self.recordings, self.splits, strict=True)
        return [segment for recording, splits in pairs for segment in segments_of(recording, splits)]

    def shifted(self, commands: float = 0.0, poses: float = 0.0) -> "Prepared":
        """Return the same with the stamps of commands and poses moved on by these times [s]."""
        late, moved = round(commands / SECONDS), round(poses / SECONDS)
        return replace(
            self,
            recordings=[_shifted(recording, late, moved) for recording in self.recordings],
            splits=[tuple(split + moved for split in splits) for splits in self.splits],
            commands_shifted=self.commands_shifted + commands,
            poses_shifted=self.poses_shifted + poses,
        )


def prepare(recordings: Sequence[Recording]) -> Prepared:
    """Check the recordings, set aside what cannot be true, and set the clock of the poses by that of the wheels."""
    ready, splits, sentences, doubts = [], [], [], []
    for recording in recordings:
        findings = check(recording)
        lag = findings.lag("poses")
        if lag is not None and lag.reference != "wheels":
            lag = None  # against commands a slow motor looks like a late pose
        late = 0 if lag is None or abs(lag.seconds) < LEAST_LAG else round(lag.seconds / SECONDS)
        ready.append(_shifted(findings.cleaned(recording), 0, -late))
        splits.append(tuple(int(split) - late for split in findings.splits))
        sentences += findings.sentences()
        doubts.append(UNKNOWN_CLOCK_STD if lag is None else max(LAG_MARGIN * lag.std, LEAST_CLOCK_STD))
    return Prepared(ready, splits, tuple(dict.fromkeys(sentences)), max(doubts))


def _shifted(recording: Recording, commands: int, poses: int) -> Recording:
    """Return the recording with the stamps of commands and poses moved on by these times [us]."""
    if commands:
        # What was really sent stands in the wheels' messages; as commands of their own it can have another clock.
        duty = recording.duty
        unknown = np.full(len(recording.wheels), np.nan)
        fields = recording.wheels.fields | {"applied_left": unknown, "applied_right": unknown}
        recording = replace(recording, commands=_moved(duty, commands), wheels=replace(recording.wheels, fields=fields))
    return replace(recording, poses=_moved(recording.poses, poses))


def _moved(signal: Signal, time: int) -> Signal:
    return replace(signal, utime=signal.utime + time)
