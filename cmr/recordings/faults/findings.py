"""Findings of checks, in words and numbers, with the samples to exclude."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cmr.recordings.faults.uneven_stamps import EvenStamps
from cmr.recordings.lags import Lag
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Mask, Times


@dataclass(frozen=True)
class Finding:
    """The finding of one check.

    `found` is a count, 0 means no problem; `sentence` is text for a person. `set_aside` marks by signal the samples to
    exclude, each mask of the signal's shape.
    """

    check: str
    found: int
    sentence: str
    set_aside: Mapping[str, Mask] = field(default_factory=dict)


@dataclass(frozen=True)
class Findings:
    """The findings of all checks of a recording.

    `splits` are the times [us] of the first pose after each jump of the tracker, and after each pause of the whole
    recording, where paths are split. `lags` are the offsets of the sensors' clocks, `rates` [Hz] the rates of the
    signals. `wheels_late` is the latency of wheel readings, if any; the lags then refer to corrected wheels.
    `even_stamps` are corrected stamps; all other findings are based on them.
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
        """Return how much later a sensor (poses, gyro, wheels) is stamped than its reference; None if unknown."""
        return next((lag for lag in self.lags if lag.sensor == sensor and lag.known), None)

    def sentences(self) -> list[str]:
        """Return a sentence for each check with a finding."""
        return [finding.sentence for finding in self.all if finding.found]

    def data_checks(self) -> list[dict[str, str | int]]:
        """Return every check with its count, for a diagnosis."""
        return [{"check": finding.check, "found": finding.found} for finding in self.all]

    def stamped(self, recording: Recording) -> Recording:
        """Return the checked recording with the stamps used for all findings."""
        for stamps in self.even_stamps:
            recording = stamps.of(recording)
        return recording

    def cleaned(self, recording: Recording) -> Recording:
        """Return the checked recording without the samples to exclude."""
        keep: dict[str, Mask] = {}
        for finding in self.all:
            for name, mask in finding.set_aside.items():
                keep[name] = keep.get(name, np.ones(len(mask), np.bool_)) & ~mask
        return recording.where({name: mask for name, mask in keep.items() if not mask.all()})


def counted(count: int, what: str) -> str:
    """Return a count with its noun: "1 pose", "3 poses"."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
