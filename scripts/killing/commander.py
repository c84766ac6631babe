"""A program that commands robot 0 at 50 Hz, or writes its parameter file without end: python -m killing.commander."""

import sys
import time
from pathlib import Path

from cmr.bus.bus import Bus
from cmr.bus.claiming import Claim
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import COMMAND_CLAIM, MOTOR_COMMAND
from cmr.msg import motor_command_t
from cmr.parameters.file import ParameterFile, Value

PERIOD = 0.02  # s
ZEROS = 10  # of each 50 commands; a driver that was started again takes nothing else before one
DUTY = 0.5


def command(url: str) -> None:
    """Command half duty, and zero for a fifth of each second."""
    bus, count = Bus(url), 0
    claim = Claim("killed", 0, lambda: bus.sender, take_over=True)
    while True:
        utime, count = now_utime(), count + 1
        if (claimed := claim.message(utime)) is not None:
            bus.publish(COMMAND_CLAIM, claimed, 0)
        duty = DUTY if count % (5 * ZEROS) > ZEROS else 0.0
        bus.publish(MOTOR_COMMAND, make(motor_command_t, utime=utime, robot_id=0, left=duty, right=duty), 0)
        time.sleep(PERIOD)


def write(path: Path) -> None:
    """Write a parameter file again and again, each time another one."""
    count = 0
    while True:
        count += 1
        ParameterFile(0, {"k1": Value(0.1), "base_width": Value(0.2 + 1e-6 * count)}).save(path)


if __name__ == "__main__":
    _, what, where = sys.argv
    if what == "command":
        command(where)
    write(Path(where))
