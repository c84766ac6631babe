"""One signal of a recording: the values of a sensor, or of commands, over time."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
Mask = NDArray[np.bool_]

SECONDS = 1e-6  # per microsecond


def no_times() -> Times:
    """Return an empty array of times."""
    return np.empty(0, np.int64)


@dataclass(frozen=True)
class Signal:
    """The values of one sensor, or of commands, over time.

    `utime` [us] is strictly increasing, shape (n,); `fields` holds one array of shape (n,) for each field of the
    message type, in its units. `number`, shape (n,), is the order of arrival among all messages of the recording; it is
    empty if unknown. `left_out` counts by reason the messages of the signal that are not samples.
    """

    utime: Times
    fields: dict[str, Floats]
    number: Times = field(default_factory=no_times)
    left_out: Mapping[str, int] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.utime)

    def __getitem__(self, field: str) -> Floats:
        return self.fields[field]

    @property
    def seconds(self) -> Floats:
        """Time of each sample since the first [s], shape (n,)."""
        return np.asarray((self.utime - self.utime[:1]) * SECONDS, np.float64)

    def between(self, first: int, last: int) -> "Signal":
        """Return the part from utime `first` to `last`, both included."""
        return self.where((self.utime >= first) & (self.utime <= last))

    def varies(self, *names: str) -> bool:
        """Return whether any of these fields ever changes; non-finite values do not count."""
        fields = [self.fields[name] for name in names] if len(self) else []
        return any(bool(np.any(np.diff(values[np.isfinite(values)]))) for values in fields)

    def where(self, keep: Mask) -> "Signal":
        """Return the samples at which `keep`, shape (n,), is true."""
        fields = {name: values[keep] for name, values in self.fields.items()}
        return Signal(self.utime[keep], fields, self.number[keep] if len(self.number) else self.number, self.left_out)


def hold(signal: Signal, field: str, times: Times) -> Floats:
    """Return the value in force at each time: the last one before it, 0 before the first."""
    index = np.searchsorted(signal.utime, times, side="right") - 1
    if len(signal) == 0:
        return np.zeros(len(times))
    return np.where(index >= 0, signal[field][np.maximum(index, 0)], 0.0)
