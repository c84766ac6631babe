"""Rows of cmr-view: jumps in a log of an hour, before and after it has been read completely."""

import random
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks import long_log
from benchmarks.report import Row
from cmr.recordings.events import EventReader
from cmr.view.data.log_index import LogIndex
from cmr.view.data.playback import Playback

HOUR = 3600  # s
JUMPS = 40
LONGEST = 0.25  # s per jump; the specification allows 0.5 s
SEED = 7


def view() -> Iterator[Row]:
    """Measure the time of a jump, and of reading the log."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.lcm"
        long_log.write(path, HOUR)
        playback = Playback(LogIndex(EventReader(path)))
        yield _jumps(playback, "before it has been read")
        before = time.process_time()
        while not playback.index.build(1.0):
            pass
        yield Row(f"cmr-view: reading a log of {path.stat().st_size / 1e9:.1f} GB", f"{_cpu(before):.0f} s")
        yield _jumps(playback, "after it has been read")


def _jumps(playback: Playback, when: str) -> Row:
    rng = random.Random(SEED)
    waits = []
    for _ in range(JUMPS):
        moment = rng.randint(playback.index.begin, playback.index.end)
        before = time.perf_counter()
        playback.jump(moment)
        waits.append(time.perf_counter() - before)
    return Row(
        f"cmr-view: {JUMPS} jumps in a log of one hour with ten robots, {when}; wall, the longest in brackets",
        f"{1e3 * statistics.median(waits):.0f} ms ({1e3 * max(waits):.0f})",
        goal=f"{1e3 * LONGEST:.0f} ms",
        reached=max(waits) <= LONGEST,
    )


def _cpu(before: float) -> float:
    return time.process_time() - before
