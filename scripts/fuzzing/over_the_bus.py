"""All processes of a robot on a bus of their own that is flooded with messages: does any die, hang or grow?"""

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
LONGEST_HANG = 0.5  # s beyond that
LOST = 0.06  # s by which a gap may miss whole periods, where it is a report that was lost on the way
LARGEST_GROWTH = 30e6  # bytes
LOADING = 30.0  # s in which a process loads what it needs; one that lives shorter after it is not measured
SETTLING = 300.0  # s, or a third of all: what is there by then may stay
SAMPLE, MEMORY_SAMPLE = 0.1, 5.0  # s
SAMPLES = 3_000  # that are looked back upon
START_UP, ENDING = 900.0, 20.0  # s
CALM = 3.0  # s after the flood
DUTY, DRIVEN, AT_REST = 0.3, 1.0, 0.05  # duty, and wheel speeds [rad/s] at which a robot drives and stands
STOPPED_WITHIN = 1.5  # s after the last command
FLOODED = 250.0  # messages a second on the open bus; each of the others is sent a fifth
PAGE = os.sysconf("SC_PAGE_SIZE")
ORDERLY = {"pilot": "took over robot", "calibrate": ""}  # those that may end, and what their last words then say
WIDTH, EXAMPLES = 300, 8


class Gap(NamedTuple):
    """A time between two reports of a process: when it ended, how long it was, and for how long [s] others ran."""

    at: float
    seconds: float
    waited: float
    probe_late: float

    @property
    def is_lost(self) -> bool:
        """Whether it looks as if one report, or some, had been lost on the way."""
        periods = round(self.seconds / PERIOD)
        return periods > 1 and abs(self.seconds - periods * PERIOD) < LOST

    @property
    def is_hang(self) -> bool:
        """Whether the process itself kept still for too long."""
        return not self.is_lost and self.seconds - PERIOD - max(self.waited, self.probe_late) > LONGEST_HANG


@dataclass
class Watched:
    """A process: its command, and what was seen of it."""

    name: str
    command: list[str]
    environment: dict[str, str]
    running: "subprocess.Popen[bytes] | None" = None
    starts: int = 0
    deaths: list[str] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    longest: float = PERIOD  # s between two reports
    reports: int = 0
    memory: list[tuple[float, int]] = field(default_factory=list)  # s, bytes; of the present process
    growths: list[float] = field(default_factory=list)
    last: int | None = None  # stamp of the last report [us]
    waits: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=SAMPLES))  # us, and the waits [s]

    def waited(self, begin: int, end: int) -> float:
        """Return for how long [s] its threads waited for a processor between the samples around two moments [us]."""
        before = [waits for utime, waits in self.waits if utime <= begin]
        after = [waits for utime, waits in self.waits if utime >= end]
        first = before[-1] if before else self.waits[0][1] if self.waits else 0.0
        return (after[0] if after else _waited(self.running.pid) if self.running else first) - first


class Flood:
    """The processes, their buses and what floods these; a context manager."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._folder, self._seed = folder, seed
        self.open_url, self.signed_url, self.foreign_url = private_url(), private_url(), private_url()
        self._senders: list[subprocess.Popen[bytes]] = []
        self._probe_late: list[tuple[float, float]] = []  # when, and by how much [s] this process woke up late
        write_new_key(folder / "key", replace=True)
        self.processes = {one.name: one for one in self._watched()}

    def __enter__(self) -> "Flood":
        with ExitStack() as undo:
            undo.push(self.__exit__)
            self._begin()
            undo.pop_all()
        return self

    def _begin(self) -> None:
        """Start all processes, and wait until each has reported."""
        self._buses = [Bus(self.open_url)]
        os.environ["CMR_KEY"] = str(self._folder / "key")
        self._buses.append(Bus(self.signed_url))
        del os.environ["CMR_KEY"]
        for bus in self._buses:
            bus.subscribe(PROCESS_STATUS, every=True)
        self._buses[0].subscribe(MOTOR_FEEDBACK, ROBOT, every=True)
        for one in self.processes.values():
            self._start(one)
            if one.name == "emulate":
                _until(lambda: "ready" in self.said("emulate"), START_UP)
        _until(self._all_run, START_UP)

    def __exit__(self, *_error: object) -> None:
        self._end_senders()
        for one in reversed(self.processes.values()):
            if one.running is not None and one.running.poll() is None:
                one.running.terminate()
        for one in self.processes.values():
            if one.running is not None:
                try:
                    one.running.wait(ENDING)
                except subprocess.TimeoutExpired:
                    one.running.kill()
                    one.running.wait()

    def said(self, name: str) -> str:
        """Return what a process printed."""
        path = self._folder / f"{name}.txt"
        return path.read_text("utf-8", errors="replace") if path.exists() else ""

    def run(self, seconds: float) -> None:
        """Flood for so long, and watch."""
        plan = (
            (self.open_url, FLOODED, ""),
            (self.signed_url, FLOODED / 5, "key"),
            (self.foreign_url, FLOODED / 5, ""),
        )
        for number, (url, rate, key) in enumerate(plan):
            command = [sys.executable, "-m", "fuzzing.sender", url, str(rate), str(self._seed + number)]
            environment = os.environ | ({"CMR_KEY": str(self._folder / "key")} if key else {})
            with (self._folder / f"sender_{number}.txt").open("ab") as said:
                self._senders.append(subprocess.Popen(command, env=environment, stdout=said, stderr=said))
        self._began = time.monotonic()
        memory = 0.0
        due = time.monotonic()
        while (now := time.monotonic()) - self._began < seconds:
            self._probe_late.append((now, max(now - due, 0.0)))
            self._listen()
            self._look_for_deaths()
            for one in self.processes.values():
                if one.running is not None:
                    one.waits.append((now_utime(), _waited(one.running.pid)))
            if now - self._began >= memory:
                memory += MEMORY_SAMPLE
                self._measure(now - self._began)
            due = time.monotonic() + SAMPLE
            time.sleep(SAMPLE)
        self._end_senders()
        self._settle()

    def sent(self) -> int:
        """Return how many messages were sent."""
        texts = [self.said(f"sender_{number}").split() for number in range(len(self._senders))]
        return sum(int(words[-1]) for words in texts if words and words[-1].isdecimal())

    def senders_died(self) -> bool:
        """Return whether a sender ended by itself."""
        return any(sender.returncode not in (-signal.SIGTERM, None) for sender in self._senders)

    def drives_and_stops(self) -> str:
        """Drive the robot after the flood; return what went wrong, empty if nothing did."""
        pilot = self.processes["pilot"].running
        assert pilot is not None
        pilot.terminate()
        pilot.wait(ENDING)
        bus, driving = self._buses[0], False
        claim = Claim("fuzz_bus", ROBOT, lambda: bus.sender, take_over=True)
        decided, began = now_utime(), time.monotonic()
        while time.monotonic() < began + 10.0 and not driving:
            now = now_utime()
            if time.monotonic() < began + 2.0:
                freed = {"engaged": False, "source": "fuzz_bus", "reason": "the flood is over"}
                bus.publish(ESTOP, make(estop_t, utime=now if time.monotonic() < began + 0.4 else decided, **freed))
            if (claimed := claim.message(now)) is not None:
                bus.publish(COMMAND_CLAIM, claimed, ROBOT)
            duty = DUTY if time.monotonic() > began + 3.0 else 0.0
            bus.publish(MOTOR_COMMAND, make(motor_command_t, utime=now, robot_id=ROBOT, left=duty, right=duty), ROBOT)
            driving = any(min(speeds) > DRIVEN for speeds in self._speeds())
            time.sleep(0.02)
        if not driving:
            return "the robot does not drive after the flood"
        stopped = time.monotonic()
        while time.monotonic() < stopped + STOPPED_WITHIN:
            if any(max(map(abs, speeds)) < AT_REST for speeds in self._speeds()):
                return ""
            time.sleep(0.02)
        return f"the robot does not stand {STOPPED_WITHIN} s after the last command"

    def _speeds(self) -> Iterator[tuple[float, float]]:
        for received in self._buses[0].receive(0.0):
            if isinstance(received.message, motor_feedback_t):
                yield received.message.psi_left, received.message.psi_right

    def _watched(self) -> Iterator[Watched]:
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
            yield Watched(name, [*CMR, *arguments], no_key)
        recorder = [sys.executable, "-m", "cmr.experiments.live.recorder", str(folder / "run.lcm")]
        yield Watched("recorder", recorder, no_key)
        yield Watched("agent", [*CMR, "agent", "--out", str(folder / "agent")], key)
        relayed = ["--channel", "POSE_*", "--channel", "GYRO_*", "--channel", "W*", "--from", self.foreign_url]
        yield Watched("relay", [*CMR, "relay", *relayed], key)
        signed_sim = ["sim", "--parameters", str(folder), "--virtual", "20=figure_eight,laps=0"]
        yield Watched("sim with key", [*CMR, *signed_sim], key)

    def _start(self, one: Watched) -> None:
        with (self._folder / f"{one.name}.txt").open("ab") as said:
            one.running = subprocess.Popen(one.command, env=os.environ | one.environment, stdout=said, stderr=said)
        one.starts, one.last, one.memory = one.starts + 1, None, []
        one.waits.clear()

    def _all_run(self) -> bool:
        self._look_for_deaths()
        self._listen()
        return all(one.last is not None for one in self.processes.values())

    def _listen(self) -> None:
        by_pid = {one.running.pid: one for one in self.processes.values() if one.running is not None}
        for bus in self._buses:
            for received in bus.receive(0.0):
                message = received.message
                if isinstance(message, process_status_t) and message.pid in by_pid:
                    self._note(by_pid[message.pid], message)

    def _note(self, one: Watched, report: process_status_t) -> None:
        if report.state == process_status_t.STARTING:
            one.last = None
            return
        if one.last is not None:
            seconds = (report.utime - one.last) / 1e6
            one.reports += 1
            one.longest = max(one.longest, seconds)
            if seconds - PERIOD > LONGEST_HANG:
                now = time.monotonic()
                late = max((late for when, late in self._probe_late if when > now - seconds - 1.0), default=0.0)
                one.gaps.append(Gap(now, seconds, one.waited(one.last, report.utime), late))
        one.last = report.utime

    def _look_for_deaths(self) -> None:
        for one in self.processes.values():
            if one.running is None or (code := one.running.poll()) is None:
                continue
            words = self.said(one.name).strip()[-WIDTH:]
            expected = ORDERLY.get(one.name)
            if expected is None or code not in (0, 1) or expected not in words or "Traceback" in self.said(one.name):
                one.deaths.append(f"ended with {code}: {words}")
            self._end_memory(one)
            self._start(one)

    def _measure(self, passed: float) -> None:
        for one in self.processes.values():
            if one.running is not None and (size := _resident(one.running.pid)):
                one.memory.append((passed, size))
                with (self._folder / "memory.csv").open("a") as table:
                    table.write(f"{one.name},{one.starts},{passed:.0f},{size}\n")

    def _settle(self) -> None:
        for one in self.processes.values():
            self._end_memory(one)
        end = time.monotonic() + CALM
        while time.monotonic() < end:
            self._listen()
            time.sleep(SAMPLE)
        self._look_for_deaths()

    def _end_memory(self, one: Watched) -> None:
        """Note how much a process grew after it had settled."""
        one.memory = [(passed, size) for passed, size in one.memory if passed >= one.memory[0][0] + LOADING]
        if not one.memory or one.memory[-1][0] - one.memory[0][0] < LOADING:
            one.memory = []
            return
        settled = one.memory[0][0] + min(SETTLING, (one.memory[-1][0] - one.memory[0][0]) / 3.0)
        before = max(size for passed, size in one.memory if passed <= settled)
        one.growths.append(max(size for _, size in one.memory) - before)
        one.memory = []

    def _end_senders(self) -> None:
        for sender in self._senders:
            if sender.poll() is None:
                sender.terminate()
                sender.wait(ENDING)


def report(flood: Flood, seconds: float, trouble: str) -> tuple[str, bool]:
    """Return a table of what was seen, and whether all is as it should be."""
    lines = [
        f"{flood.sent():,} messages in {seconds / 60.0:.1f} minutes",
        "| process | starts | deaths | reports | longest gap | hangs | lost reports | late by the machine | growth |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    problems = [trouble] if trouble else []
    for one in flood.processes.values():
        hangs, lost = sum(gap.is_hang for gap in one.gaps), sum(gap.is_lost for gap in one.gaps)
        growth = max(one.growths, default=0.0)
        cells = [one.name, one.starts, len(one.deaths), one.reports, f"{one.longest:.2f} s", hangs, lost]
        cells += [len(one.gaps) - hangs - lost, f"{growth / 1e6:.1f} MB"]
        lines.append(f"| {' | '.join(map(str, cells))} |")
        problems += [f"{one.name} {death}" for death in one.deaths[:EXAMPLES]]
        problems += [f"{one.name} hung: {gap}" for gap in one.gaps if gap.is_hang][:EXAMPLES]
        problems += [f"{one.name} has grown by {growth / 1e6:.0f} MB"] if growth > LARGEST_GROWTH else []
        problems += [f"{one.name} printed a traceback"] if "Traceback" in flood.said(one.name) else []
    problems += ["a sender ended by itself"] if flood.senders_died() else []
    return "\n".join([*lines, *(f"Found: {problem}" for problem in problems)]), not problems


def flood_and_look(folder: Path, minutes: float, seed: int) -> tuple[str, bool]:
    """Flood for so long; return what was seen, and whether all is as it should be."""
    folder.mkdir(parents=True, exist_ok=True)
    with Flood(folder, seed) as flood:
        flood.run(60.0 * minutes)
        trouble = flood.drives_and_stops()
        return report(flood, 60.0 * minutes, trouble)


def _waited(pid: int) -> float:
    """Return for how long [s] the threads of a process, together, waited for a processor so far.

    The main thread waits as well where another one has to let go of the interpreter first.
    """
    total = 0
    for path in Path(f"/proc/{pid}/task").glob("*/schedstat"):
        with suppress(OSError):
            total += int(path.read_text().split()[1])
    return total / 1e9


def _resident(pid: int) -> int:
    """Return what a process has in memory [bytes]; 0 if it is gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE
    except OSError:
        return 0


def _until(condition: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("waited in vain")
        time.sleep(SAMPLE)
