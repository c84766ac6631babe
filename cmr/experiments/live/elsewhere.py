"""Processes of a run on other machines, started by agents or by hand: whether they run, and report no problem."""

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from cmr.msg import process_status_t
from cmr.processes.job import PILOT, RECORDER, SIM, Job
from cmr.processes.requests import AGENT, short_name

LONGEST_SILENCE = 5.0  # s; each process reports once a second
NOT_IN_SERVICE = (process_status_t.STARTING, process_status_t.STOPPING)


class Elsewhere:
    """Monitors `jobs` by `statuses`, the last process_status_t of each process on other machines, by host and pid.

    PROCESS_STATUS names the program and not the robot, so programs are counted.
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        statuses: Mapping[tuple[str, int], process_status_t],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._jobs = jobs
        self._with_agent: set[str] = set()  # hosts
        self._wanted = Counter(_program(job) for job in jobs)
        self._movers = frozenset(_program(job) for job in jobs if job.role in (PILOT, SIM))
        self._statuses, self._clock = statuses, clock
        # Last report of each process, and when [s].
        self._heard: dict[tuple[str, int], tuple[process_status_t, float]] = {}
        self._greeted: set[tuple[str, int]] = set()
        self.is_needed = bool(jobs)
        self.has_sim = any(job.role == SIM for job in jobs)
        self.with_pilot = frozenset(job.robot_id for job in jobs if job.role == PILOT)

    def silent(self) -> str:
        """Return the programs that are not running; empty if all are."""
        there = Counter(status.process for status in self._in_service())
        lacking = [name for name, count in self._wanted.items() if there[name] < count]
        return f"{', '.join(lacking)} on other machines" if lacking else ""

    def doubt(self) -> str:
        """Return the first process that reports a problem, with its message; empty if none does."""
        for status in self._in_service():
            if status.process in self._wanted and status.state == process_status_t.DEGRADED:
                return f"{status.process} on {status.host}: {status.message}"
        return ""

    def newcomers(self) -> bool:
        """Return whether processes that move robots became ready since the last call."""
        movers = {(one.host, one.pid) for one in self._in_service() if one.process in self._movers}
        fresh = movers - self._greeted
        self._greeted |= movers
        return bool(fresh)

    def asked_of_agents(self) -> list[Job]:
        """Return the processes to request from agents: those of hosts with an agent, unless started by hand."""
        there = self._in_service()
        by_hand = {short_name(status.host) for status in there if status.process in self._wanted}
        agents = {short_name(status.host) for status in there if status.process == AGENT}
        self._with_agent |= agents - by_hand
        return [job for job in self._jobs if short_name(job.host or "") in self._with_agent]

    def by_hand(self) -> list[Job]:
        """Return the processes that a person has to start and end."""
        return [job for job in self._jobs if short_name(job.host or "") not in self._with_agent]

    def _in_service(self) -> list[process_status_t]:
        """Return the last reports of running processes; one without recent reports has died or is unreachable."""
        now = self._clock()
        for key, status in self._statuses.items():
            if self._heard.get(key, (None, now))[0] is not status:
                self._heard[key] = (status, now)
        return [
            status
            for status, when in self._heard.values()
            if status.state not in NOT_IN_SERVICE and now - when <= LONGEST_SILENCE
        ]


def _program(job: Job) -> str:
    """Return a process's name on PROCESS_STATUS."""
    return "cmr-run recorder" if job.role == RECORDER else Path(job.command[0]).name
