"""The pieces of a recording: continuous parts between pauses of all signals.

Tables of other people's robots often contain hundreds of short pieces, which an import joins on one clock. The motion
in between is unknown, and a tracker may start each piece in a frame of its own, so nothing may be compared across a
pause.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.signal import SECONDS, Floats, Mask, Signal, Times, no_times

PAUSE, PAUSE_PERIODS = 0.4, 4.0  # s, and intervals of the fastest signal, without any sample in a pause

Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Pieces:
    """When each piece begins and ends: `first` and `last` [us], shape (k,), those of its samples of any signal."""

    first: Times
    last: Times

    @classmethod
    def of(cls, signals: Iterable[Signal]) -> "Pieces":
        """Find the pauses without samples of any signal."""
        present = [signal.utime for signal in signals if len(signal)]
        if not present:
            return cls(no_times(), no_times())
        usual = min((float(np.median(np.diff(utime))) for utime in present if len(utime) > 1), default=0.0)
        utime = np.unique(np.concatenate(present))
        begins = np.append(True, np.diff(utime) > max(PAUSE / SECONDS, PAUSE_PERIODS * usual))
        return cls(utime[begins], utime[np.append(begins[1:], True)])

    def __len__(self) -> int:
        return len(self.first)

    @property
    def lengths(self) -> Floats:
        """How long each piece lasts [s], shape (k,)."""
        return np.asarray((self.last - self.first) * SECONDS, np.float64)

    @property
    def usual(self) -> float:
        """The length [s] such that half of all recorded time is in pieces at least as long; 0 without pieces."""
        lengths = np.sort(self.lengths)
        if not len(lengths):
            return 0.0
        return float(lengths[np.searchsorted(np.cumsum(lengths), 0.5 * lengths.sum())])

    def number(self, utime: Times) -> Numbers:
        """Return the number of the piece of each time [us], shape (n,); in a pause, the previous piece."""
        return np.maximum(np.searchsorted(self.first, utime, side="right") - 1, 0)

    def seconds(self, utime: Times) -> Floats:
        """Return the recorded time [s] up to each time [us], shape (n,), without pauses."""
        if not len(self):
            return np.zeros(len(utime))
        begins = np.append(0.0, np.cumsum(self.lengths)[:-1])
        number = self.number(utime)
        within = (np.clip(utime, self.first[number], self.last[number]) - self.first[number]) * SECONDS
        return np.asarray(begins[number] + within, np.float64)

    def borders(self, utime: Times) -> Mask:
        """Return which of the ordered times [us], shape (n,), is the first of a piece, excluding the very first."""
        return np.diff(self.number(utime), prepend=self.number(utime[:1])) > 0
