"""A last gate that breaks its promises on purpose, in the way that the environment says; for tests alone."""

import os
import sys

sys.path.insert(0, os.environ["CMR_BROKEN_GATE_PATH"])

from robot_driver.gate import guard, process


def nothing(*_arguments: object) -> None:
    """Do nothing."""


WAYS = {
    "stops nothing at its end": lambda: setattr(process.Gate, "_stop_motors", nothing),
    "never stops anything": lambda: setattr(guard.Guard, "stop_due", nothing),
    "lets commands live": lambda: setattr(guard, "LIFETIME", 10 * guard.LIFETIME),
}
WAYS[os.environ["CMR_BROKEN_GATE"]]()
process.main(sys.argv[1:])
