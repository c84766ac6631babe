"""Rows of whole processes: starting the simulator, calibrating and diagnosing from logs, and reading a log."""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

import lcm

from benchmarks.drive import NOMINAL, recording, write_log
from benchmarks.report import Row, seconds
from benchmarks.timing import Timing, all_cores, clocked, in_turns
from cmr.bus.streams import WORLD_STATE
from cmr.msg import world_state_t
from cmr.recordings import Recording
from tests.hidden_effects.hiding import hidden_recording
from tests.hidden_effects.logs import write_log as made_log
from tests.hidden_effects.pieces import in_pieces
from tests.support.private_bus import private_url

Times: TypeAlias = tuple[float, float]  # CPU seconds and wall-clock seconds

RUNS = 5
LOG_SECONDS = 120.0
COPIES = 10  # length of the longer log, in lengths of the shorter one
LONGEST_START, LONGEST_FIRST_START = 0.6, 3.0  # s
LONGEST_WAIT = 60.0  # s; limit for the first message of a simulator
LONGEST_CALIBRATION, LONGEST_DIAGNOSIS, LONGEST_READING = 3.0, 3.0, 0.25  # s
DIAGNOSES, PIECE = 3, 2.0  # runs; s
LARGEST_MEMORY = 3.0  # times the size of the log
LARGEST_GROWTH = 1.2  # of the time per byte when the log gets longer
# A reader that reports the increase of its memory: bytes.
MEMORY_OF_READING = """
import sys
from pathlib import Path
from cmr.recordings import Recording

def memory(key):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) * 1024

Recording.read(sys.argv[1])  # imports all modules, which are not to be counted
Path("/proc/self/clear_refs").write_text("5")  # resets the peak
before = memory("VmRSS")
recording = Recording.read(sys.argv[2])
print(memory("VmHWM") - before)
"""


def start() -> Iterator[Row]:
    """Measure the time from the start of cmr-sim to its first WORLD_STATE with a robot, and until that robot moves."""
    with tempfile.TemporaryDirectory() as folder:
        cache, parameters = Path(folder) / "cache", Path(folder) / "parameters"
        parameters.mkdir()
        NOMINAL.save(parameters / "robot_0.yaml")
        first = [_start_simulator(parameters, cache)]
        warm = [_start_simulator(parameters, cache) for _ in range(RUNS)]
    for title, starts, goal in (("the first time", first, LONGEST_FIRST_START), ("warm", warm, LONGEST_START)):
        states, motions = zip(*starts, strict=True)
        yield _process_row(f"cmr-sim from its start to the first WORLD_STATE with a robot, {title}", states, goal)
        yield _process_row(f"the same until the robot is simulated, {title}", motions)


def calibration() -> Iterator[Row]:
    """Measure cmr-calibrate --log as a whole process, warm."""
    with tempfile.TemporaryDirectory() as folder:
        log = _log(Path(folder))
        runs = [_command(["cmr-calibrate", "--log", str(log)], Path(folder) / "cache") for _ in range(RUNS + 1)][1:]
    title = f"cmr-calibrate --log of {LOG_SECONDS:.0f} s at 100 Hz, whole process, warm"
    yield _process_row(title, runs, LONGEST_CALIBRATION)


def diagnosis() -> Iterator[Row]:
    """Measure cmr-diagnose as a whole process, warm, on all cores, with logs of two minutes, and of ten in pieces."""
    titles = (
        (f"cmr-diagnose of {LOG_SECONDS:.0f} s at 100 Hz, two effects hidden, whole process, warm", LONGEST_DIAGNOSIS),
        (f"the same of ten minutes in pieces of {PIECE:.0f} s, late commands and poses hidden", None),
    )
    with tempfile.TemporaryDirectory() as name, all_cores():
        folder = Path(name)
        whole = hidden_recording("motor_gain_asymmetry", "gyro_latency", seed=1).recording
        longer = hidden_recording("command_delay", "pose_latency", seed=1, repeats=5).recording
        logs = made_log(folder / "run.lcm", whole), made_log(folder / "pieces.lcm", in_pieces(longer, PIECE))
        for log, (title, goal) in zip(logs, titles, strict=True):
            command = ["cmr-diagnose", str(log), "--out", str(folder / log.stem)]
            runs = [_command(command, folder / "cache") for _ in range(DIAGNOSES + 1)][1:]
            yield _process_row(title, runs, goal)


def reading() -> Iterator[Row]:
    """Measure reading a log into arrays, how its time grows with the log, and its memory."""
    with tempfile.TemporaryDirectory() as folder:
        log, longer = _log(Path(folder)), _log(Path(folder), COPIES)
        timings = in_turns(
            {"log": clocked(lambda: Recording.read(log)), "longer": clocked(lambda: Recording.read(longer))}
        )
        memory = subprocess.run(
            [sys.executable, "-c", MEMORY_OF_READING, str(log), str(longer)], capture_output=True, text=True, check=True
        )
        size, longer_size = log.stat().st_size, longer.stat().st_size
    timing = timings["log"]
    growth = timings["longer"].median / timing.median * size / longer_size
    rise = int(memory.stdout) / longer_size
    name = f"reading a log of {LOG_SECONDS:.0f} s, 4 channels at 100 Hz, {size / 1e6:.1f} MB"
    yield Row(name, seconds(timing), goal=f"{LONGEST_READING:g} s", reached=timing.median <= LONGEST_READING)
    yield Row(
        f"the same, {COPIES} times as long",
        seconds(timings["longer"]),
        f"{growth:.2f} times the time per byte",
        "linear",
        growth <= LARGEST_GROWTH,
    )
    yield Row(
        "peak memory of reading it",
        f"{rise * longer_size / 1e6:.0f} MB",
        f"{rise:.2f} times the log",
        f"{LARGEST_MEMORY:g} times",
        rise <= LARGEST_MEMORY,
    )


def _process_row(title: str, runs: Sequence[Times], goal: float | None = None) -> Row:
    """Return the row of a process from the times of its runs; the goal is for wall-clock time."""
    processor, wall = (Timing(statistics.median(times), min(times)) for times in zip(*runs, strict=True))
    measured = f"{seconds(processor)}; wall {seconds(wall)}"
    return Row(title, measured) if goal is None else Row(title, measured, "-", f"{goal:g} s", wall.median <= goal)


def _log(folder: Path, copies: int = 1) -> Path:
    path = folder / f"run_{copies}.lcm"
    write_log(path, recording(LOG_SECONDS), copies)
    return path


def _start_simulator(parameters: Path, cache: Path) -> tuple[Times, Times]:
    """Start cmr-sim with a virtual robot; return the times until a WORLD_STATE contains it, and until it moves."""
    url = private_url()
    listener = lcm.LCM(url)
    worlds: list[world_state_t] = []
    listener.subscribe(WORLD_STATE.name, lambda _channel, data: worlds.append(world_state_t.decode(data)))
    moments: list[Times] = []
    begin = time.monotonic()
    with subprocess.Popen(
        [
            *_program("cmr-sim"),
            *("--virtual", "10=figure_eight,start=0", "--parameters", str(parameters), "--lcm-url", url),
        ],
        env=_environment(cache),
        stderr=subprocess.DEVNULL,
    ) as process:
        try:
            for condition in (lambda world: world.n > 0, lambda world: any(world.x)):
                while not any(condition(world) for world in worlds):
                    listener.handle_timeout(20)
                    if process.poll() is not None or time.monotonic() > begin + LONGEST_WAIT:
                        raise RuntimeError("the robot of cmr-sim does not move; run it by hand to see why")
                moments.append((processor_time(process.pid), time.monotonic() - begin))
        finally:
            process.terminate()
    return moments[0], moments[1]


def processor_time(pid: int) -> float:
    """Return the CPU seconds that a process has used so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    user, system = int(fields[11]), int(fields[12])  # utime and stime of proc(5)
    return (user + system) / os.sysconf("SC_CLK_TCK")


def _command(command: Sequence[str], cache: Path) -> Times:
    """Run one of CMR's commands to its end; return its CPU and wall-clock seconds."""
    return command_times([*_program(command[0]), *command[1:]], cache)


def command_times(command: Sequence[str], cache: Path) -> Times:
    """Run a command to its end, with `cache` as folder for compiled code; return its CPU and wall-clock seconds."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run(command, env=_environment(cache), check=True, stdout=subprocess.DEVNULL)
    wall, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def _program(name: str) -> list[str]:
    """Return the command line of an installed command."""
    return [str(Path(sys.executable).with_name(name))]


def _environment(cache: Path) -> dict[str, str]:
    """Return the environment of a process that stores compiled code in `cache`."""
    return os.environ | {"NUMBA_CACHE_DIR": str(cache)}
