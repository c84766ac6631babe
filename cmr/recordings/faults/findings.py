"""What was found in a recording, in words and in numbers, and what to set aside."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cmr.recordings.faults.uneven_stamps import EvenStamps
from cmr.recordings.lags import Lag
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Mask, Times


@dataclass(frozen=True)
class Finding:
    """What one check found.

    `found` counts it, 0 is a clean bill; `sentence` says it to a person. `set_aside` marks by signal the samples that
    are not to be used, each mask of the signal's shape.
    """

    check: str
    found: int
    sentence: str
    set_aside: Mapping[str, Mask] = field(default_factory=dict)


@dataclass(frozen=True)
class Findings:
    """What all checks of a recording found.

    `splits` are the times [us] of the first pose after each jump of the tracker, and after each pause of the whole
    recording: a path ends before and begins there.
    `lags` tell how the sensors' clocks differ, `rates` [Hz] how often each signal came. Where the wheels tell late,
    `wheels_late` says how late, and the lags are those to wheels that were set right. `even_stamps` are those
    of wheels and poses that were stamped unevenly; everything was found with them.
    """

    all: tuple[Finding, ...]
    splits: Times
    lags: tuple[Lag, ...]
    rates: Mapping[str, float]
    wheels_late: Lag | None = None
    even_stamps: tuple[EvenStamps, ...] = ()

    def __getitem__(self, check: str) -> Finding:
        return next(finding for finding in self.all if finding.check == check)

    def lag(self, sensor: str) -> Lag | None:
        """Return by how much a sensor (poses, gyro, wheels) is stamped later than its reference; None if unknown."""
        return next((lag for lag in self.lags if lag.sensor == sensor and lag.known), None)

    def sentences(self) -> list[str]:
        """Return what was found, one sentence for each check that found something."""
        return [finding.sentence for finding in self.all if finding.found]

    def data_checks(self) -> list[dict[str, str | int]]:
        """Return every check with what it counted, as it stands in a diagnosis."""
        return [{"check": finding.check, "found": finding.found} for finding in self.all]

    def stamped(self, recording: Recording) -> Recording:
        """Return the recording, the one that was checked, with the stamps with which everything was found."""
        for stamps in self.even_stamps:
            recording = stamps.of(recording)
        return recording

    def cleaned(self, recording: Recording) -> Recording:
        """Return the recording, the one that was checked, without the samples to set aside."""
        keep: dict[str, Mask] = {}
        for finding in self.all:
            for name, mask in finding.set_aside.items():
                keep[name] = keep.get(name, np.ones(len(mask), np.bool_)) & ~mask
        return recording.where({name: mask for name, mask in keep.items() if not mask.all()})


def counted(count: int, what: str) -> str:
    """Return a count with its noun: "1 pose", "3 poses"."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
