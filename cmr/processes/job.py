"""A process of an experiment: what it is for, its command, where it runs, and in which order such processes start."""

from dataclasses import dataclass
from pathlib import Path

# What a process is for.
RECORDER, EMULATOR, DRIVER, SIM = "recorder", "emulator", "driver", "sim"
CALIBRATOR, DIAGNOSER, PILOT = "calibrator", "diagnoser", "pilot"
START_ORDER = (RECORDER, EMULATOR, DRIVER, SIM, CALIBRATOR, DIAGNOSER, PILOT)
# Those that command motors first, those that hold them next, and the recorder at last.
STOP_ORDER = (PILOT, CALIBRATOR, DIAGNOSER, SIM, DRIVER, EMULATOR, RECORDER)

CANNOT_WRITE = 74  # exit code of a recorder that cannot write any more; EX_IOERR of sysexits.h


@dataclass(frozen=True)
class Job:
    """One process: its name, what it is for, its command, and the robot that it belongs to, if to one.

    It is started when there is a file `after`. `host` is the machine on which it runs; None: this one.
    """

    name: str
    role: str
    command: list[str]
    robot_id: int | None = None
    after: Path | None = None
    host: str | None = None
    once: bool = False  # never started again: it would begin its drive again, from wherever the robot is
