"""Processes on this machine for experiments led by another: requested, supervised and stopped."""

from collections.abc import Mapping
from pathlib import Path

from cmr.bus.message import Message
from cmr.files import write_atomically
from cmr.msg import process_request_t, process_status_t
from cmr.plain_text import plain
from cmr.processes.children import Children
from cmr.processes.requests import Request, RequestError, is_this_host, read_request
from cmr.processes.supervisor import State, Supervisor

LAPSE = 5.0  # s without a request after which the run is over: cmr-run died or is unreachable
LONGEST_NAME = 80  # characters of a run and of a process
MOST_PROCESSES = 200


class Agent:
    """Serves one run at a time in a folder of its own in `base`; independent of the bus. Call `stop` at the end.

    A process is restarted, or not, by the same rules as in cmr-run.
    """

    def __init__(self, base: Path) -> None:
        self.refused = ""  # the last request that failed, and why
        self._base, self._children = base, Children(base)
        self._run = ""
        self._heard = 0.0  # s, of the last request for the run
        self._files: dict[str, str] = {}
        self._degraded: set[int] = set()
        self._supervisor = self._new_supervisor()

    def handle(self, _utime: int, _channel: str, message: Message, now: float) -> None:
        """Handle a process_request_t or a process_status_t; `now` is any monotonic time [s]."""
        if isinstance(message, process_status_t) and is_this_host(message.host):
            held = message.state == process_status_t.DEGRADED
            if message.pid in (state.pid for state in self.states.values()):
                (self._degraded.add if held else self._degraded.discard)(message.pid)
        elif isinstance(message, process_request_t) and is_this_host(message.host):
            try:
                self._take(read_request(message, self._base), now)
            except (RequestError, OSError) as error:
                self._refuse(f"{message.name} of {message.run}", error)

    def poll(self, now: float) -> list[str]:
        """Start and stop what is due; return sentences on what happened."""
        if self._run and now > self._heard + LAPSE:
            run = self._run
            self.stop()
            return [f"Nothing was heard of {run} for {LAPSE:.0f} s: its processes were stopped."]
        try:
            return self._supervisor.poll(now)
        except OSError as error:  # a full disk, or a process that cannot be started; it is tried again
            self._refuse(f"a process of {self._run}", error)
            return []

    def stop(self) -> None:
        """Stop all processes, those that command motors first; the agent is free for another run."""
        self._supervisor.stop()
        self._supervisor = self._new_supervisor()
        self._run, self._files = "", {}

    @property
    def sentence(self) -> str:
        """The agent's state, for PROCESS_STATUS."""
        running = ", ".join(name for name in self.states if self._supervisor.is_running(name))
        serves = f"{self._run}: {running or 'nothing'} runs." if self._run else "Serves no run."
        return f"{serves} Not started: {self.refused}." if self.refused else serves

    @property
    def states(self) -> Mapping[str, State]:
        """The state of each requested process."""
        return self._supervisor.states

    @property
    def down(self) -> list[str]:
        """The processes that ended early and are not running."""
        return self._supervisor.down()

    def _refuse(self, what: str, error: Exception) -> None:
        self.refused = plain(f"{what[:LONGEST_NAME]}: {error}", 2 * LONGEST_NAME)

    def _take(self, request: Request, now: float) -> None:
        name = plain(request.job.name, LONGEST_NAME)
        if not self._run and request.wanted:
            self._run, self.refused = request.run, ""
            self._children.folder = request.folder
        if request.run != self._run:
            if request.wanted:
                raise RequestError(f"this machine serves {self._run}")
            return
        self._heard = now
        if not request.wanted:
            self.stop()  # a run ends as a whole
        elif name not in self.states:
            if len(self.states) >= MOST_PROCESSES:
                raise RequestError("there are too many processes")
            self._write(request)
            self._supervisor.states[name] = State(request.job)

    def _write(self, request: Request) -> None:
        """Write files that are new; a process may have changed existing ones."""
        request.folder.mkdir(parents=True, exist_ok=True)
        for name, text in request.files.items():
            if self._files.get(name) != text:
                write_atomically(text, request.folder / name)
                self._files[name] = text

    def _new_supervisor(self) -> Supervisor:
        return Supervisor([], self._children, held=lambda pid: pid in self._degraded)
