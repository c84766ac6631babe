"""Join recordings of one robot to one recording with several pieces."""

from collections.abc import Sequence

import numpy as np

from cmr.recordings.arrivals import KEPT
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Signal

APART = round(10.0 / SECONDS)  # us between two of them: every check treats it as a pause


def one_after_another(recordings: Sequence[Recording]) -> Recording:
    """Return one recording with these as pieces, in order; parameters are the first one's."""
    shifts, end = [], 0
    for recording in recordings:
        times = [signal.utime for signal in recording.signals.values() if len(signal)]
        first, last = min((int(t[0]) for t in times), default=0), max((int(t[-1]) for t in times), default=0)
        shifts.append(end - first)
        end += last - first + APART
    parts = {name: _joined([getattr(recording, name) for recording in recordings], shifts) for name in KEPT}
    return recordings[0].with_signals(parts)


def _joined(signals: Sequence[Signal], shifts: Sequence[int]) -> Signal:
    """Return the samples of all signals, each signal's times shifted [us], with the fields that all have."""
    present = [(one, shift) for one, shift in zip(signals, shifts, strict=True) if len(one)]
    if not present:
        return signals[0]
    names = set.intersection(*(set(one.fields) for one, _ in present))
    return Signal(
        np.concatenate([one.utime + shift for one, shift in present]),
        {name: np.concatenate([one[name] for one, _ in present]) for name in sorted(names)},
    )
