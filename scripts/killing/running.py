"""Kill random processes of a robot, restart them, and measure when the robot stops and when it drives again."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from random import Random
from types import TracebackType

from cmr.bus.bus import Bus
from cmr.bus.messages import now_utime
from cmr.bus.streams import PROCESS_STATUS, WORLD_STATE
from cmr.commands.first_use import BEHAVIOURS, EMULATOR, MODEL, WORLD, compile_first
from cmr.msg import process_status_t, robot_state_t, world_state_t
from cmr.parameters.file import ParameterFileError, load
from killing.results import (
    DRIVER,
    DRIVES,
    GATE,
    PILOT,
    SIMULATOR,
    TWIN,
    VICTIMS,
    WRITER,
    ZERO,
    Kill,
    append_result,
    read_results,
    report,
    stalled_time,
)
from killing.robot import PORT, Robot
from tests.support.gates import gates_of
from tests.support.private_bus import private_url
from tests.support.stalls import Interval, Stalls

TIMEOUT = 30.0  # s; by then, every event is late
START_TIMEOUT = 120.0  # s; at the first use, the model is compiled
POLL_PERIOD = 0.001  # s
RESTART_DELAY = 0.2  # s, as with systemd
SHOWN = 500  # last characters of a process's output that are shown after a failed check
PARAMETERS = Path(__file__).parents[2] / "cmr" / "experiments" / "scenario" / "shipped" / "parameters" / "robot_0.yaml"
CMR = [sys.executable, "-m", "cmr"]


class Kills:
    """A robot and its processes; use it as a context manager."""

    def __init__(self, folder: Path, controller: str, rng: Random) -> None:
        self._folder, self._controller, self._rng = folder, controller, rng
        self._file = folder / PARAMETERS.name
        shutil.copyfile(PARAMETERS, self._file)
        url = private_url()
        self._bus = Bus(url)
        self._bus.subscribe(WORLD_STATE)
        self._bus.subscribe(PROCESS_STATUS, every=True)
        self._robot, self._stalls = Robot(folder, controller), Stalls()
        bus, driven = ["--lcm-url", url], ["--port", str(folder / PORT), "--controller", controller]
        behaviour = ["--behaviour", "killing.programs:Circle", "--parameters", str(self._file)]
        self._commands = {
            SIMULATOR: [*CMR, "sim", *bus, "--parameters", str(folder)],
            DRIVER: [*CMR, "driver", *bus, *driven, "--state", str(folder / "state")],
            PILOT: [*CMR, "pilot", *bus, *behaviour],
            WRITER: [sys.executable, "-m", "killing.programs", str(self._file)],
        }
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._torn = ""

    def __enter__(self) -> "Kills":
        with ExitStack() as stack:
            stack.enter_context(self._stalls)
            stack.enter_context(self._robot)
            stack.callback(self._end)
            for name in self._commands:
                self._start(name)
            self._wait_until(self._has_twin_since(0), START_TIMEOUT)
            self._wait_until(self._robot.is_driving, START_TIMEOUT)
            self._ending = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ending.close()

    def kill_one(self) -> Kill:
        """Kill one of the processes while the robot drives, and wait until it drives again; return the result."""
        victim = self._rng.choice(VICTIMS)
        time.sleep(self._rng.uniform(0.0, 1.0))
        self._wait_until(self._robot.is_driving, START_TIMEOUT)
        if not self._robot.is_driving():
            raise SystemExit(f"The robot does not drive again.\n{self.output()}")
        self._receive()
        self._torn = ""
        intervals = self._kill_and_wait(victim)
        self._receive()
        self._check_file()
        self._stalls.look()
        seconds = {event: interval.end - interval.begin for event, interval in intervals.items()}
        stalled = {event: stalled_time(self._stalls.seen, interval) for event, interval in intervals.items()}
        self._stalls.seen.clear()
        return Kill(self._controller, victim, seconds, stalled, self._torn)

    def output(self) -> str:
        """Return the end of each process's output."""
        files = [self._folder / f"{name}.txt" for name in self._commands]
        return "\n".join(f"{file.stem}: ...{file.read_text(errors='replace')[-SHOWN:]}" for file in files)

    def _kill_and_wait(self, victim: str) -> dict[str, Interval]:
        """Kill a process and restart it; return the interval from the kill or restart to each event."""
        intervals: dict[str, Interval] = {}
        restarted = killed = time.monotonic()
        self._kill(victim)
        if victim == GATE:  # its driver restarts it
            intervals[ZERO] = Interval(killed, self._wait_until(self._robot.is_stopped, TIMEOUT))
        else:
            if victim != WRITER:
                intervals[ZERO] = Interval(killed, self._time_of_lasting_stop(killed + TIMEOUT))
            self._receive()
            restarted = time.monotonic()
            self._start(victim)
        if victim == SIMULATOR:
            intervals[TWIN] = Interval(restarted, self._wait_until(self._has_twin_since(now_utime()), TIMEOUT))
        if victim != WRITER:
            intervals[DRIVES] = Interval(restarted, self._wait_until(self._robot.is_driving, TIMEOUT))
        return intervals

    def _time_of_lasting_stop(self, end: float) -> float:
        """Return when the robot stopped for at least the delay of a restart [s of the monotonic clock]."""
        while True:
            stopped = self._wait_until(self._robot.is_stopped, TIMEOUT)
            moved = self._wait_until(lambda: not self._robot.is_stopped(), RESTART_DELAY)
            if moved >= min(stopped + RESTART_DELAY, end):
                return stopped

    def _kill(self, victim: str) -> None:
        if victim == GATE:
            for gate in gates_of(self._running[DRIVER].pid):
                os.kill(gate, signal.SIGKILL)
            return
        process = self._running[victim]
        process.kill()
        process.wait()

    def _start(self, name: str) -> None:
        with (self._folder / f"{name}.txt").open("ab") as log:
            self._running[name] = subprocess.Popen(self._commands[name], stdout=log, stderr=log, cwd=self._folder)

    def _end(self) -> None:
        for process in self._running.values():
            process.kill()
            process.wait()

    def _check_file(self) -> None:
        try:
            load(self._file)
        except ParameterFileError as error:
            self._torn = str(error)

    def _receive(self) -> list[world_state_t]:
        """Return the world states that were published; record reports that the parameter file cannot be read."""
        messages = [received.message for received in self._bus.receive(0.0)]
        for message in messages:
            if isinstance(message, process_status_t) and self._file.name in message.message:
                self._torn = f"{message.process}: {message.message}"
        return [message for message in messages if isinstance(message, world_state_t)]

    def _has_twin_since(self, utime: int) -> Callable[[], bool]:
        """Return a condition: whether a world state later than `utime` [us] contains the robot's twin."""
        return lambda: any(
            world.utime > utime and robot_state_t.TWIN in world.origin[: world.n] for world in self._receive()
        )

    def _wait_until(self, condition: Callable[[], object], seconds: float) -> float:
        """Wait until the condition holds or `seconds` have passed; return the time [s of the monotonic clock]."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self._restart_ended()
            time.sleep(POLL_PERIOD)
        return time.monotonic()

    def _restart_ended(self) -> None:
        """Restart processes that ended by themselves, as systemd and cmr-run do."""
        for name, process in list(self._running.items()):
            if process.returncode is None and process.poll() is not None:
                time.sleep(RESTART_DELAY)
                self._start(name)


def kill_and_report(kills: int, seed: int, controller: str, out: Path | None) -> tuple[str, bool]:
    """Kill processes until there are `kills` results for this controller.

    Earlier results are read from `out`, and new ones appended to it. Return a table of all results, and whether all
    checks passed.
    """
    compile_first([MODEL, WORLD, BEHAVIOURS, EMULATOR])
    results = read_results(out) if out else []
    done = sum(result.controller == controller for result in results)
    rng = Random(f"{seed} {controller} {done}")
    with (
        tempfile.TemporaryDirectory(prefix="cmr-kill-") as folder,
        Kills(Path(folder), controller, rng) as robot,
    ):
        for _ in range(done, kills):
            results.append(robot.kill_one())
            if out:
                append_result(results[-1], out)
            for fault in results[-1].faults():
                print(fault, robot.output(), sep="\n", file=sys.stderr, flush=True)
    return report(results)
