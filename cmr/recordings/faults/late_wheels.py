"""Detect late wheel readings, which are older than their stamps.

Many commercial robots filter the speeds that they report, or stamp them on arrival. The gyro then turns before the
wheels do, which is impossible; a gyro clock that is ahead looks the same, and poses may be as late as the wheels. The
earliest sensor, gyro or poses, is taken as reference, so that none reports the future. A common latency of all is
unknown: it counts as command_delay.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from cmr.recordings.lags import Lag
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS

SURELY = 3.0  # standard deviations
IN_TIME = Lag("wheels", "gyro", 0.0, 0.0)  # for wheels that are known not to be late


def late_wheels(recording: Recording, lags: Sequence[Lag]) -> Lag | None:
    """Return the lag of the wheels behind the earliest other sensor in these `lags`; None if they need not be late.

    CMR's driver stamps wheels when they are read, so they are never late. The same holds for wheels that would
    otherwise turn before they were commanded to.
    """
    known = {lag.sensor: lag for lag in lags if lag.known}
    first = known.get("gyro")
    if first is None or first.reference != "wheels" or first.seconds >= 0.0 or recording.driven_on_the_bus:
        return None
    if "poses" in known and _is_before(known["poses"], first):
        first = known["poses"]
    late = Lag("wheels", first.sensor, -first.seconds, first.std)
    return None if "wheels" in known and _is_before(known["wheels"], late) else late


def _is_before(one: Lag, other: Lag) -> bool:
    """Return whether a lag is significantly smaller than another."""
    return one.seconds < other.seconds - SURELY * float(np.hypot(one.std, other.std))


def with_wheels_in_time(recording: Recording, late: Lag) -> Recording:
    """Return the recording with its wheel stamps corrected for their latency."""
    wheels = recording.wheels
    return replace(recording, wheels=replace(wheels, utime=wheels.utime - round(late.seconds / SECONDS)))


def together(found: Iterable[Lag | None]) -> Lag | None:
    """Return the mean wheel lag over several recordings of one robot; None if none shows it."""
    known = [lag for lag in found if lag is not None]
    if not known:
        return None
    weights = np.array([lag.std**-2.0 for lag in known])
    mean = float(weights @ [lag.seconds for lag in known] / weights.sum())
    return Lag("wheels", known[0].reference, mean, float(weights.sum() ** -0.5))
