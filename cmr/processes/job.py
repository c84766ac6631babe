"""A process of an experiment: its role, command, host, and starting order."""

from dataclasses import dataclass
from pathlib import Path

# The role of a process.
RECORDER, EMULATOR, DRIVER, SIM = "recorder", "emulator", "driver", "sim"
CALIBRATOR, DIAGNOSER, PILOT = "calibrator", "diagnoser", "pilot"
START_ORDER = (RECORDER, EMULATOR, DRIVER, SIM, CALIBRATOR, DIAGNOSER, PILOT)
# Stopping order: those that command motors, those that hold them, and the recorder last.
STOP_ORDER = (PILOT, CALIBRATOR, DIAGNOSER, SIM, DRIVER, EMULATOR, RECORDER)

CANNOT_WRITE = 74  # exit code of a recorder that cannot write any more; EX_IOERR of sysexits.h


@dataclass(frozen=True)
class Job:
    """One process: its name, role and command, and the robot it belongs to, if any.

    It is started once the file `after` exists. `host` is its machine; None: this one.
    """

    name: str
    role: str
    command: list[str]
    robot_id: int | None = None
    after: Path | None = None
    host: str | None = None
    once: bool = False  # never restarted: it would repeat its drive from wherever the robot is
