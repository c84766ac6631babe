"""Start the processes of a run, restart what dies if that is safe, and stop all in order."""

import signal
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from cmr.processes.children import Children
from cmr.processes.job import CANNOT_WRITE, DRIVER, PILOT, RECORDER, STOP_ORDER, Job

FIRST_DELAY = 0.5  # s until a process that died is restarted; doubled each time
LONGEST_DELAY = 30.0  # s
PROVEN = 30.0  # s after which a process counts as healthy, and the delay is reset
MOST_ENDS = 50  # ends kept for a process that dies repeatedly
WRONG_USAGE = 2
ASKED_TO_END = frozenset({130, -signal.SIGINT, -signal.SIGTERM, -signal.SIGHUP})


@dataclass
class State:
    """The state of a process; times are those of the supervisor's clock."""

    job: Job
    due: float | None = 0.0  # time of the next start; None: not (again)
    started: float = 0.0
    delay: float = FIRST_DELAY
    starts: int = 0
    pid: int = 0  # of the process as it was last started
    ends: list[str] = field(default_factory=list)  # how it ended, the last times

    @property
    def restarts(self) -> int:
        """How often it was started again."""
        return max(self.starts - 1, 0)


class Supervisor:
    """Keeps the processes of a run alive.

    `held(pid)` returns whether a driver or pilot last reported holding its robot for a reason; if it ends then it is
    not restarted, nor is a process that somebody ended. A process waits while `may_start(job)` is false. `prepare(job)`
    is called before each start.
    """

    def __init__(
        self,
        jobs: Iterable[Job],
        children: Children,
        held: Callable[[int], bool] = lambda _pid: False,
        prepare: Callable[[Job], None] = lambda _job: None,
        may_start: Callable[[Job], bool] = lambda _job: True,
    ) -> None:
        self.states = {job.name: State(job) for job in jobs}
        self._children = children
        self._held = held
        self._prepare = prepare
        self._may_start = may_start

    @property
    def restarts(self) -> int:
        """How often processes were started again."""
        return sum(state.restarts for state in self.states.values())

    def poll(self, now: float) -> list[str]:
        """Start what is due, and detect ended processes; return sentences about these. `now` is any monotonic time
        [s].
        """
        sentences = [self._note_end(name, code, now) for name, code in self._children.ended().items()]
        for state in self.states.values():
            if state.due is not None and now >= state.due and self._can_start(state.job):
                self._prepare(state.job)
                state.pid = self._children.start(state.job.name, state.job.command)
                state.due, state.started = None, now
                state.starts += 1
        return sentences

    def stop(self) -> None:
        """Stop everything in order: those that command motors, those that hold them, the recorder last."""
        for role in STOP_ORDER:
            names = [name for name, state in self.states.items() if state.job.role == role]
            for name, code in self._children.stop(*names).items():
                self.states[name].ends.append(_how(code))
        for state in self.states.values():
            state.due = None

    def is_running(self, name: str) -> bool:
        """Return whether a process runs."""
        return self._children.is_running(name)

    def is_done(self, name: str) -> bool:
        """Return whether a process ended normally."""
        ends = self.states[name].ends
        return not self.is_running(name) and bool(ends) and ends[-1] == _how(0)

    def down(self) -> list[str]:
        """Return the processes that ended early and are not running."""
        started = (name for name, state in self.states.items() if state.starts)
        return [name for name in started if not self.is_running(name) and not self.is_done(name)]

    def given_up(self) -> list[str]:
        """Return those of them that are not restarted."""
        return [name for name in self.down() if self.states[name].due is None]

    @property
    def is_unrecorded(self) -> bool:
        """Whether a recorder failed to write."""
        recorders = (state for state in self.states.values() if state.job.role == RECORDER)
        return any(_how(CANNOT_WRITE) in state.ends[-1:] for state in recorders)

    def last_words(self, name: str) -> str:
        """Return the last line that a process said; empty if there is none."""
        return self._children.last_words(name)

    def _can_start(self, job: Job) -> bool:
        return (job.after is None or job.after.exists()) and self._may_start(job)

    def _note_end(self, name: str, code: int, now: float) -> str:
        state = self.states[name]
        state.ends.append(_how(code))
        del state.ends[:-MOST_ENDS]
        said = self._children.last_words(name)
        end = f"{name} {_how(code)}{': ' + said if said and code else '.'}"
        why_not = self._why_not_again(state, code)
        if why_not:
            return f"{end} {why_not}"
        if now - state.started > PROVEN:
            state.delay = FIRST_DELAY
        state.due = now + state.delay
        delay, state.delay = state.delay, min(2.0 * state.delay, LONGEST_DELAY)
        return f"{end} Started again in {delay:g} s."

    def _why_not_again(self, state: State, code: int) -> str:
        """Return a sentence on why a process is not restarted; empty if it is."""
        if code == 0:
            return "It is done."
        if code == WRONG_USAGE:
            return "It would fail again."
        if code in ASKED_TO_END:
            return "Somebody ended it, so it is not restarted."
        job = state.job
        if job.role == RECORDER and code == CANNOT_WRITE:
            return "It would fail again: the run ends."
        if job.role == PILOT and (job.once or code > 0):
            return "It would begin its drive again, so it is not restarted; the robot stays still."
        if job.role in (DRIVER, PILOT) and self._held(state.pid):
            return "It stopped the robot for a reason, so it is not restarted; the robot stays still."
        return ""


def _how(code: int) -> str:
    """Return how a process ended."""
    if code in ASKED_TO_END:
        return "stopped normally"
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"was ended by signal {-code}"
