"""Recent messages of one robot: each stream on its own time line, in bounded memory."""

from collections import deque
from typing import TypeAlias

import numpy as np

from cmr.recordings.signal import Floats

COLUMNS = {
    "commands": ("left", "right"),
    "wheels": ("psi_left", "psi_right", "applied_left", "applied_right", "battery_voltage", "status"),
    "gyro": ("yaw_rate",),
    "poses": ("x", "y", "theta"),
}
MOST = 4_000  # messages kept of a stream; 3 s at more than 1 kHz

Row: TypeAlias = tuple[float, ...]


class Hearing:
    """The messages of the last seconds, by stream: a name of COLUMNS."""

    def __init__(self) -> None:
        self._rows: dict[str, deque[Row]] = {name: deque(maxlen=MOST) for name in COLUMNS}

    def take(self, stream: str, utime: int, row: Row) -> None:
        """Store the values of a message of time `utime` [us]: the stream's columns, in order."""
        self._rows[stream].append((utime, *row))

    def between(self, stream: str, first: int, last: int, origin: int) -> Floats:
        """Return what was measured from utime `first` to `last`, shape (n, 1 + columns), ordered in time.

        The first column is the time [s] since utime `origin`; of messages with the same time the last is used.
        """
        by_time = {row[0]: row for row in self._rows[stream] if first <= row[0] <= last}
        rows = np.array(sorted(by_time.values()), np.float64).reshape(len(by_time), 1 + len(COLUMNS[stream]))
        rows[:, 0] = (rows[:, 0] - origin) * 1e-6
        return rows

    def keep(self, first: int, last: int) -> None:
        """Drop values stamped before utime `first` or after `last`."""
        for name, rows in self._rows.items():
            self._rows[name] = deque((row for row in rows if first <= row[0] <= last), MOST)

    def __len__(self) -> int:
        return sum(map(len, self._rows.values()))
