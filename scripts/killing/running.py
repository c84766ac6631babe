"""Kill processes of a robot by chance, start them again, and measure when it stood and when it drove again."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from random import Random

from cmr.parameters.file import ParameterFileError, load
from tests.support.driver_bench import START_DRIVER, Robot
from tests.support.gates import gates_of
from tests.support.private_bus import private_url

COMMANDER, DRIVER, GATE, WRITER = "commander", "driver", "gate", "writer"
VICTIMS = (COMMANDER, DRIVER, GATE, WRITER)
ZERO_WITHIN = 0.56  # s
BACK_WITHIN = 2.0  # s
PATIENCE = 30.0  # s, at the beginning and after what was too late already
LOOK = 0.001  # s
STILL, MOVING = [0, 0], 8000  # duties that the device was sent; 32767 is full
RESTART = 0.2  # s until a process is started again, as by systemd
PROGRAM = [sys.executable, "-m", "killing.commander"]


class Kills:
    """A robot and its processes; `seconds` has how long each thing took, by what was killed and what happened."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.seconds: defaultdict[tuple[str, str], list[float]] = defaultdict(list)
        self.torn: list[str] = []
        self._folder, self._chance = folder, Random(seed)
        self._file = folder / "robot_0.yaml"
        self._robot = Robot(folder)
        self._url = private_url()
        driver = ["--port", str(folder / "motor"), "--lcm-url", self._url, "--state", str(folder / "state")]
        self._commands = {
            COMMANDER: [*PROGRAM, "command", self._url],
            DRIVER: [*START_DRIVER, *driver],
            WRITER: [*PROGRAM, "write", str(self._file)],
        }
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> "Kills":
        for name in self._commands:
            self._start(name)
        self._until(self._drives, PATIENCE)
        self._until(self._file.exists, PATIENCE)
        return self

    def __exit__(self, *_error: object) -> None:
        for process in self._running.values():
            process.kill()
            process.wait()
        self._robot.unplug()

    def kill_one(self) -> None:
        """Kill one of the processes while the robot drives, and see it drive again."""
        victim = self._chance.choice(VICTIMS)
        time.sleep(self._chance.uniform(0.0, 1.0))
        self._until(self._drives, PATIENCE)
        killed = time.monotonic()
        self._kill(victim)
        if victim != WRITER:
            self.seconds[victim, "zero"].append(self._until(self._stands, PATIENCE) - killed)
        else:
            self._check_file()
        back = killed
        if victim != GATE:
            time.sleep(RESTART)
            back = time.monotonic()
            self._start(victim)
        if victim != WRITER:
            self.seconds[victim, "back"].append(self._until(self._drives, PATIENCE) - back)

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
            self._running[name] = subprocess.Popen(self._commands[name], stdout=said, stderr=said)

    def _check_file(self) -> None:
        try:
            load(self._file)
        except ParameterFileError as error:
            self.torn.append(str(error))

    def _drives(self) -> bool:
        return min(self._robot.device.duty) > MOVING

    def _stands(self) -> bool:
        return self._robot.device.duty == STILL

    def _until(self, condition: Callable[[], object], seconds: float) -> float:
        """Return when the condition came to hold [s of the monotonic clock], or when patience ended."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            time.sleep(LOOK)
        return time.monotonic()


def kill_and_look(kills: int, seed: int) -> tuple[str, bool]:
    """Kill so often; return what came out, as a table, and whether all is as it should be."""
    with tempfile.TemporaryDirectory(prefix="cmr-kill-") as folder, Kills(Path(folder), seed) as robot:
        for _ in range(kills):
            robot.kill_one()
    lines, is_sound = ["| killed | until | kills | median | latest | at most |", "|---|---|---|---|---|---|"], True
    for (victim, what), seconds in sorted(robot.seconds.items()):
        limit = ZERO_WITHIN if what == "zero" else BACK_WITHIN
        words = "the duty is zero" if what == "zero" else "it drives again"
        median = sorted(seconds)[len(seconds) // 2]
        lines.append(f"| {victim} | {words} | {len(seconds)} | {median:.2f} s | {max(seconds):.2f} s | {limit:g} s |")
        is_sound &= max(seconds) <= limit
    lines += [f"A parameter file was torn: {text}" for text in robot.torn]
    return "\n".join(lines), is_sound and not robot.torn
