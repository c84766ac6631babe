"""Measure how long the processes of a soak test, and the kernel's workers, wait for a processor."""

from pathlib import Path

PROC = Path("/proc")
WORKER = "kworker/u"  # kernel threads, some of which transfer the bytes of pseudo-terminals
LONG = 5_000  # us; shorter waits of a worker are normal
REFRESH_AFTER = 20  # samples between updates of the list of threads


class SchedulerWaits:
    """Sums the waits of all threads of some processes, and the long waits of the kernel's workers."""

    def __init__(self, processes: tuple[int, ...]) -> None:
        self._processes = processes
        self._total = 0
        self._before: dict[Path, int] = {}
        self._threads: list[Path] = []
        self._workers: list[Path] = []
        self._until_refresh = 0

    def sample(self) -> int:
        """Return how long they have waited since the first sample [us]."""
        if self._until_refresh == 0:
            self._until_refresh = REFRESH_AFTER
            self._threads = [path for pid in self._processes for path in (PROC / str(pid) / "task").glob("*/schedstat")]
            self._workers = [path.with_name("schedstat") for path in PROC.glob("[0-9]*/comm") if _is_worker(path)]
        self._until_refresh -= 1
        self._total += sum(self._since(path) for path in self._threads)
        self._total += sum(wait for wait in map(self._since, self._workers) if wait > LONG)
        return self._total

    def _since(self, path: Path) -> int:
        """Return how long a thread has waited since the last sample [us]; 0 if it is new or has ended."""
        try:
            waited = int(path.read_text().split()[1]) // 1000
        except OSError:
            return 0
        before, self._before[path] = self._before.get(path, waited), waited
        return waited - before


def _is_worker(path: Path) -> bool:
    try:
        return path.read_text().startswith(WORKER)
    except OSError:
        return False
