"""Flood a private bus with all processes of a robot, and check that no process dies, hangs or grows in memory."""

import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from cmr.bus.bus import Bus
from cmr.bus.claiming import Claim
from cmr.bus.keys import write_new_key
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import COMMAND_CLAIM, ESTOP, MOTOR_COMMAND, MOTOR_FEEDBACK, PROCESS_STATUS
from cmr.msg import estop_t, motor_command_t, motor_feedback_t, process_status_t
from tests.support.private_bus import private_url

ROBOT = 0
CMR = [sys.executable, "-m", "cmr"]
PERIOD = 1.0  # s between reports of a process
LONGEST_HANG = 0.5  # s that a gap may exceed the period
LOST_TOLERANCE = 0.06  # s; a gap this close to a multiple of the period means that a report was lost
LARGEST_GROWTH = 30e6  # bytes
LOADING = 30.0  # s after a start that are not measured; afterwards, a process must run as long again to be measured
SETTLING = 300.0  # s, or a third of the time if that is shorter; growth is measured against the maximum until then
SAMPLE, MEMORY_SAMPLE = 0.1, 5.0  # s
SAMPLES = 3_000  # of the waiting time that are kept
START_TIMEOUT, END_TIMEOUT = 900.0, 20.0  # s
CALM = 3.0  # s after the flood
DUTY, DRIVING, AT_REST = 0.3, 1.0, 0.05  # duty, and wheel speeds [rad/s] above and below which a robot drives or stands
STOPPED_WITHIN = 1.5  # s after the last command
MESSAGE_RATE = 250.0  # messages per second on the open bus; each of the other two buses receives a fifth of it
PAGE = os.sysconf("SC_PAGE_SIZE")
MAY_END = {"pilot": "took over robot", "calibrate": ""}  # processes that may end, and words that they then print
WIDTH, EXAMPLES = 300, 8


class Gap(NamedTuple):
    """A long gap between two reports of a process.

    `at` is its end on the monotonic clock, `seconds` its length. `waited` is the time that the process waited for a
    processor, `probe_late` the delay with which this program woke up meanwhile, both in s.
    """

    at: float
    seconds: float
    waited: float
    probe_late: float

    @property
    def is_lost(self) -> bool:
        """Whether the gap looks as if reports had been lost on the bus."""
        periods = round(self.seconds / PERIOD)
        return periods > 1 and abs(self.seconds - periods * PERIOD) < LOST_TOLERANCE

    @property
    def is_hang(self) -> bool:
        """Whether the process itself was silent for too long."""
        return not self.is_lost and self.seconds - PERIOD - max(self.waited, self.probe_late) > LONGEST_HANG


@dataclass
class WatchedProcess:
    """A process: its command, and what was observed."""

    name: str
    command: list[str]
    environment: dict[str, str]
    running: "subprocess.Popen[bytes] | None" = None
    starts: int = 0
    deaths: list[str] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    longest: float = PERIOD  # s between two reports
    reports: int = 0
    memory: list[tuple[float, int]] = field(default_factory=list)  # s, bytes; since the last start
    growths: list[float] = field(default_factory=list)
    last: int | None = None  # timestamp of the last report [us]
    waits: deque[tuple[int, float]] = field(
        default_factory=lambda: deque(maxlen=SAMPLES)
    )  # time [us], total wait so far [s]

    def waited(self, begin: int, end: int) -> float:
        """Return how long [s] its threads waited for a processor between `begin` and `end` [us], at sample times."""
        before = [waits for utime, waits in self.waits if utime <= begin]
        after = [waits for utime, waits in self.waits if utime >= end]
        first = before[-1] if before else self.waits[0][1] if self.waits else 0.0
        return (after[0] if after else _scheduler_wait(self.running.pid) if self.running else first) - first


class Flood:
    """The processes, their buses and the senders that flood these; a context manager."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._folder, self._seed = folder, seed
        self.open_url, self.signed_url, self.foreign_url = private_url(), private_url(), private_url()
        self._senders: list[subprocess.Popen[bytes]] = []
        self._probe_late: list[tuple[float, float]] = []  # time, and delay of this program's wake-up [s]
        write_new_key(folder / "key", replace=True)
        self.processes = {process.name: process for process in self._watched()}

    def __enter__(self) -> "Flood":
        with ExitStack() as undo:
            undo.push(self.__exit__)
            self._begin()
            undo.pop_all()
        return self

    def _begin(self) -> None:
        """Start all processes, and wait until each has sent a report."""
        self._buses = [Bus(self.open_url)]
        os.environ["CMR_KEY"] = str(self._folder / "key")
        self._buses.append(Bus(self.signed_url))
        del os.environ["CMR_KEY"]
        for bus in self._buses:
            bus.subscribe(PROCESS_STATUS, every=True)
        self._buses[0].subscribe(MOTOR_FEEDBACK, ROBOT, every=True)
        for process in self.processes.values():
            self._start(process)
            if process.name == "emulate":
                _wait_until(lambda: "ready" in self.output("emulate"), START_TIMEOUT)
        _wait_until(self._all_run, START_TIMEOUT)

    def __exit__(self, *_error: object) -> None:
        self._end_senders()
        for process in reversed(self.processes.values()):
            if process.running is not None and process.running.poll() is None:
                process.running.terminate()
        for process in self.processes.values():
            if process.running is not None:
                try:
                    process.running.wait(END_TIMEOUT)
                except subprocess.TimeoutExpired:
                    process.running.kill()
                    process.running.wait()

    def output(self, name: str) -> str:
        """Return the output of a process."""
        path = self._folder / f"{name}.txt"
        return path.read_text("utf-8", errors="replace") if path.exists() else ""

    def run(self, seconds: float) -> None:
        """Flood the buses for `seconds`, and observe the processes."""
        plan = (
            (self.open_url, MESSAGE_RATE, ""),
            (self.signed_url, MESSAGE_RATE / 5, "key"),
            (self.foreign_url, MESSAGE_RATE / 5, ""),
        )
        for number, (url, rate, key) in enumerate(plan):
            command = [sys.executable, "-m", "fuzzing.sender", url, str(rate), str(self._seed + number)]
            environment = os.environ | ({"CMR_KEY": str(self._folder / "key")} if key else {})
            with (self._folder / f"sender_{number}.txt").open("ab") as log:
                self._senders.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log))
        self._began = time.monotonic()
        memory = 0.0
        due = time.monotonic()
        while (now := time.monotonic()) - self._began < seconds:
            self._probe_late.append((now, max(now - due, 0.0)))
            self._listen()
            self._look_for_deaths()
            for process in self.processes.values():
                if process.running is not None:
                    process.waits.append((now_utime(), _scheduler_wait(process.running.pid)))
            if now - self._began >= memory:
                memory += MEMORY_SAMPLE
                self._measure(now - self._began)
            due = time.monotonic() + SAMPLE
            time.sleep(SAMPLE)
        self._end_senders()
        self._settle()

    def sent(self) -> int:
        """Return the number of messages sent by all senders."""
        texts = [self.output(f"sender_{number}").split() for number in range(len(self._senders))]
        return sum(int(words[-1]) for words in texts if words and words[-1].isdecimal())

    def senders_died(self) -> bool:
        """Return whether a sender ended before it was stopped."""
        return any(sender.returncode not in (-signal.SIGTERM, None) for sender in self._senders)

    def drives_and_stops(self) -> str:
        """Drive the robot after the flood; return the problem, empty if there is none."""
        pilot = self.processes["pilot"].running
        assert pilot is not None
        pilot.terminate()
        pilot.wait(END_TIMEOUT)
        bus, driving = self._buses[0], False
        claim = Claim("fuzz_bus", ROBOT, lambda: bus.sender, take_over=True)
        decided, began = now_utime(), time.monotonic()
        while time.monotonic() < began + 10.0 and not driving:
            now = now_utime()
            if time.monotonic() < began + 2.0:
                released = {"engaged": False, "source": "fuzz_bus", "reason": "the flood is over"}
                bus.publish(ESTOP, make(estop_t, utime=now if time.monotonic() < began + 0.4 else decided, **released))
            if (claimed := claim.message(now)) is not None:
                bus.publish(COMMAND_CLAIM, claimed, ROBOT)
            duty = DUTY if time.monotonic() > began + 3.0 else 0.0
            bus.publish(MOTOR_COMMAND, make(motor_command_t, utime=now, robot_id=ROBOT, left=duty, right=duty), ROBOT)
            driving = any(min(speeds) > DRIVING for speeds in self._speeds())
            time.sleep(0.02)
        if not driving:
            return "the robot does not drive after the flood"
        stopped = time.monotonic()
        while time.monotonic() < stopped + STOPPED_WITHIN:
            if any(max(map(abs, speeds)) < AT_REST for speeds in self._speeds()):
                return ""
            time.sleep(0.02)
        return f"the robot is still moving {STOPPED_WITHIN} s after the last command"

    def _speeds(self) -> Iterator[tuple[float, float]]:
        for received in self._buses[0].receive(0.0):
            if isinstance(received.message, motor_feedback_t):
                yield received.message.psi_left, received.message.psi_right

    def _watched(self) -> Iterator[WatchedProcess]:
        folder, no_key = self._folder, {"LCM_DEFAULT_URL": self.open_url}
        key = {"LCM_DEFAULT_URL": self.signed_url, "CMR_KEY": str(folder / "key")}
        parameters = Path(__file__).parents[2] / "cmr/experiments/scenario/shipped/parameters/robot_0.yaml"
        (folder / "robot_0.yaml").write_text(parameters.read_text())
        file = str(folder / "robot_0.yaml")
        motor, gyro = str(folder / "ports" / "motor"), str(folder / "ports" / "gyro")
        driver = ["--port", motor, "--gyro-port", gyro, "--state", str(folder / "state")]
        virtual = ("10=figure_eight,laps=0,start=0", "11=follow,leader=0", "12=waypoints,x=2")
        commands = {
            "emulate": ["emulate", "--ports", str(folder / "ports"), "--ideal"],
            "driver": ["driver", *driver, "--parameters", file],
            "sim": ["sim", "--parameters", str(folder), "--virtual", *virtual, "--range-sensor", "10"],
            "pilot": ["pilot", "--parameters", file, "--behaviour", "figure_eight,laps=0", "--take-over"],
            "calibrate": ["calibrate", "--robot", "0", "--parameters", file, "--out", str(folder / "found.yaml")],
            "diagnose": [
                "diagnose",
                "--live",
                "--robot",
                "0",
                "--parameters",
                file,
                "--out",
                str(folder / "diagnosis"),
            ],
            "view": ["view", "--port", "18300"],
        }
        for name, arguments in commands.items():
            yield WatchedProcess(name, [*CMR, *arguments], no_key)
        recorder = [sys.executable, "-m", "cmr.experiments.live.recorder", str(folder / "run.lcm")]
        yield WatchedProcess("recorder", recorder, no_key)
        yield WatchedProcess("agent", [*CMR, "agent", "--out", str(folder / "agent")], key)
        relayed = ["--channel", "POSE_*", "--channel", "GYRO_*", "--channel", "W*", "--from", self.foreign_url]
        yield WatchedProcess("relay", [*CMR, "relay", *relayed], key)
        signed_sim = ["sim", "--parameters", str(folder), "--virtual", "20=figure_eight,laps=0"]
        yield WatchedProcess("sim with key", [*CMR, *signed_sim], key)

    def _start(self, process: WatchedProcess) -> None:
        with (self._folder / f"{process.name}.txt").open("ab") as log:
            environment = os.environ | process.environment
            process.running = subprocess.Popen(process.command, env=environment, stdout=log, stderr=log)
        process.starts, process.last, process.memory = process.starts + 1, None, []
        process.waits.clear()

    def _all_run(self) -> bool:
        self._look_for_deaths()
        self._listen()
        return all(process.last is not None for process in self.processes.values())

    def _listen(self) -> None:
        by_pid = {process.running.pid: process for process in self.processes.values() if process.running is not None}
        for bus in self._buses:
            for received in bus.receive(0.0):
                message = received.message
                if isinstance(message, process_status_t) and message.pid in by_pid:
                    self._note(by_pid[message.pid], message)

    def _note(self, process: WatchedProcess, report: process_status_t) -> None:
        if report.state == process_status_t.STARTING:
            process.last = None
            return
        if process.last is not None:
            seconds = (report.utime - process.last) / 1e6
            process.reports += 1
            process.longest = max(process.longest, seconds)
            if seconds - PERIOD > LONGEST_HANG:
                now = time.monotonic()
                late = max((late for when, late in self._probe_late if when > now - seconds - 1.0), default=0.0)
                process.gaps.append(Gap(now, seconds, process.waited(process.last, report.utime), late))
        process.last = report.utime

    def _look_for_deaths(self) -> None:
        for process in self.processes.values():
            if process.running is None or (code := process.running.poll()) is None:
                continue
            output = self.output(process.name)
            last_words = output.strip()[-WIDTH:]
            expected = MAY_END.get(process.name)
            if expected is None or code not in (0, 1) or expected not in last_words or "Traceback" in output:
                process.deaths.append(f"ended with {code}: {last_words}")
            self._end_memory(process)
            self._start(process)

    def _measure(self, passed: float) -> None:
        for process in self.processes.values():
            if process.running is not None and (size := _resident(process.running.pid)):
                process.memory.append((passed, size))
                with (self._folder / "memory.csv").open("a") as table:
                    table.write(f"{process.name},{process.starts},{passed:.0f},{size}\n")

    def _settle(self) -> None:
        for process in self.processes.values():
            self._end_memory(process)
        end = time.monotonic() + CALM
        while time.monotonic() < end:
            self._listen()
            time.sleep(SAMPLE)
        self._look_for_deaths()

    def _end_memory(self, process: WatchedProcess) -> None:
        """Record by how much the memory of a process grew after it had settled."""
        process.memory = [(passed, size) for passed, size in process.memory if passed >= process.memory[0][0] + LOADING]
        if not process.memory or process.memory[-1][0] - process.memory[0][0] < LOADING:
            process.memory = []
            return
        settled = process.memory[0][0] + min(SETTLING, (process.memory[-1][0] - process.memory[0][0]) / 3.0)
        before = max(size for passed, size in process.memory if passed <= settled)
        process.growths.append(max(size for _, size in process.memory) - before)
        process.memory = []

    def _end_senders(self) -> None:
        for sender in self._senders:
            if sender.poll() is None:
                sender.terminate()
                sender.wait(END_TIMEOUT)


def report(flood: Flood, seconds: float, trouble: str) -> tuple[str, bool]:
    """Return a table of the observations, and whether no problem was found."""
    lines = [
        f"{flood.sent():,} messages in {seconds / 60.0:.1f} minutes",
        "| process | starts | deaths | reports | longest gap | hangs | lost reports | delayed by machine | growth |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    problems = [trouble] if trouble else []
    for process in flood.processes.values():
        hangs, lost = sum(gap.is_hang for gap in process.gaps), sum(gap.is_lost for gap in process.gaps)
        growth = max(process.growths, default=0.0)
        cells = [
            process.name,
            process.starts,
            len(process.deaths),
            process.reports,
            f"{process.longest:.2f} s",
            hangs,
            lost,
        ]
        cells += [len(process.gaps) - hangs - lost, f"{growth / 1e6:.1f} MB"]
        lines.append(f"| {' | '.join(map(str, cells))} |")
        problems += [f"{process.name} {death}" for death in process.deaths[:EXAMPLES]]
        problems += [f"{process.name} hung: {gap}" for gap in process.gaps if gap.is_hang][:EXAMPLES]
        problems += [f"{process.name} grew by {growth / 1e6:.0f} MB"] if growth > LARGEST_GROWTH else []
        problems += [f"{process.name} printed a traceback"] if "Traceback" in flood.output(process.name) else []
    problems += ["a sender ended by itself"] if flood.senders_died() else []
    return "\n".join([*lines, *(f"Found: {problem}" for problem in problems)]), not problems


def flood_and_report(folder: Path, minutes: float, seed: int) -> tuple[str, bool]:
    """Flood for `minutes`; return a report, and whether no problem was found."""
    folder.mkdir(parents=True, exist_ok=True)
    with Flood(folder, seed) as flood:
        flood.run(60.0 * minutes)
        trouble = flood.drives_and_stops()
        return report(flood, 60.0 * minutes, trouble)


def _scheduler_wait(pid: int) -> float:
    """Return how long [s] the threads of a process, together, have waited for a processor so far.

    This includes waiting of the main thread for another thread to release the interpreter lock.
    """
    total = 0
    for path in Path(f"/proc/{pid}/task").glob("*/schedstat"):
        with suppress(OSError):
            total += int(path.read_text().split()[1])
    return total / 1e9


def _resident(pid: int) -> int:
    """Return the resident memory of a process [bytes]; 0 if it has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE
    except OSError:
        return 0


def _wait_until(condition: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"processes were not ready within {seconds:.0f} s")
        time.sleep(SAMPLE)
