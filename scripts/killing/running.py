"""Kill processes of a robot by chance, start them again, and measure when it stood and when it drove again."""

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
    keep,
    kept,
    report,
    stood_still,
)
from killing.robot import PORT, Robot
from tests.support.gates import gates_of
from tests.support.private_bus import private_url
from tests.support.stalls import Interval, Stalls

PATIENCE = 30.0  # s, after what was too late already
FIRST = 120.0  # s; at the first use, the model is compiled
LOOK = 0.001  # s
RESTART = 0.2  # s until a process is started again, as by systemd
SAID = 500  # last characters of what a process said, where something was wrong
PARAMETERS = Path(__file__).parents[2] / "cmr" / "experiments" / "scenario" / "shipped" / "parameters" / "robot_0.yaml"
CMR = [sys.executable, "-m", "cmr"]


class Kills:
    """A robot and its processes; use it as a context manager."""

    def __init__(self, folder: Path, controller: str, chance: Random) -> None:
        self._folder, self._controller, self._chance = folder, controller, chance
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
            self._until(self._has_twin_since(0), FIRST)
            self._until(self._robot.drives, FIRST)
            self._ending = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ending.close()

    def kill_one(self) -> Kill:
        """Kill one of the processes while the robot drives, and see it drive again."""
        victim = self._chance.choice(VICTIMS)
        time.sleep(self._chance.uniform(0.0, 1.0))
        self._until(self._robot.drives, FIRST)
        if not self._robot.drives():
            raise SystemExit(f"The robot does not drive again.\n{self.said()}")
        self._listen()
        self._torn = ""
        took = self._kill_and_wait(victim)
        self._listen()
        self._check_file()
        self._stalls.look()
        seconds = {what: interval.end - interval.begin for what, interval in took.items()}
        stalled = {what: stood_still(self._stalls.seen, interval) for what, interval in took.items()}
        self._stalls.seen.clear()
        return Kill(self._controller, victim, seconds, stalled, self._torn)

    def said(self) -> str:
        """Return the last that each process said."""
        files = [self._folder / f"{name}.txt" for name in self._commands]
        return "\n".join(f"{file.stem}: ...{file.read_text(errors='replace')[-SAID:]}" for file in files)

    def _kill_and_wait(self, victim: str) -> dict[str, Interval]:
        """Kill a process and start it again; return from when to when it took until what followed."""
        took: dict[str, Interval] = {}
        back = killed = time.monotonic()
        self._kill(victim)
        if victim == GATE:  # its driver starts it
            took[ZERO] = Interval(killed, self._until(self._robot.stands, PATIENCE))
        else:
            if victim != WRITER:
                took[ZERO] = Interval(killed, self._stands_for_good(killed + PATIENCE))
            self._listen()
            back = time.monotonic()
            self._start(victim)
        if victim == SIMULATOR:
            took[TWIN] = Interval(back, self._until(self._has_twin_since(now_utime()), PATIENCE))
        if victim != WRITER:
            took[DRIVES] = Interval(back, self._until(self._robot.drives, PATIENCE))
        return took

    def _stands_for_good(self, end: float) -> float:
        """Return when the robot came to stand [s of the monotonic clock], which it then did until the restart."""
        while True:
            stood = self._until(self._robot.stands, PATIENCE)
            moved = self._until(lambda: not self._robot.stands(), RESTART)
            if moved >= min(stood + RESTART, end):
                return stood

    def _kill(self, victim: str) -> None:
        if victim == GATE:
            for gate in gates_of(self._running[DRIVER].pid):
                os.kill(gate, signal.SIGKILL)
            return
        process = self._running[victim]
        process.kill()
        process.wait()

    def _start(self, name: str) -> None:
        with (self._folder / f"{name}.txt").open("ab") as said:
            self._running[name] = subprocess.Popen(self._commands[name], stdout=said, stderr=said, cwd=self._folder)

    def _end(self) -> None:
        for process in self._running.values():
            process.kill()
            process.wait()

    def _check_file(self) -> None:
        try:
            load(self._file)
        except ParameterFileError as error:
            self._torn = str(error)

    def _listen(self) -> list[world_state_t]:
        """Return the worlds that were published; note who could not read the parameter file."""
        messages = [received.message for received in self._bus.receive(0.0)]
        for message in messages:
            if isinstance(message, process_status_t) and self._file.name in message.message:
                self._torn = f"{message.process}: {message.message}"
        return [message for message in messages if isinstance(message, world_state_t)]

    def _has_twin_since(self, utime: int) -> Callable[[], bool]:
        """Return what looks whether a world that is newer [us] has the robot's twin."""
        return lambda: any(
            world.utime > utime and robot_state_t.TWIN in world.origin[: world.n] for world in self._listen()
        )

    def _until(self, condition: Callable[[], object], seconds: float) -> float:
        """Return when the condition came to hold [s of the monotonic clock], or when patience ended."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self._start_what_ended()
            time.sleep(LOOK)
        return time.monotonic()

    def _start_what_ended(self) -> None:
        """Start again what ended by itself, as systemd and cmr-run do."""
        for name, process in list(self._running.items()):
            if process.returncode is None and process.poll() is not None:
                time.sleep(RESTART)
                self._start(name)


def kill_and_look(kills: int, seed: int, controller: str, out: Path | None) -> tuple[str, bool]:
    """Kill until there are so many results of this controller.

    `out` has results of before and gets those of now. Returns what came out of all, as a table, and whether all is as
    it should be.
    """
    compile_first([MODEL, WORLD, BEHAVIOURS, EMULATOR])
    results = kept(out) if out else []
    done = sum(result.controller == controller for result in results)
    chance = Random(f"{seed} {controller} {done}")
    with (
        tempfile.TemporaryDirectory(prefix="cmr-kill-") as folder,
        Kills(Path(folder), controller, chance) as robot,
    ):
        for _ in range(done, kills):
            results.append(robot.kill_one())
            if out:
                keep(results[-1], out)
            for fault in results[-1].faults():
                print(fault, robot.said(), sep="\n", file=sys.stderr, flush=True)
    return report(results)
