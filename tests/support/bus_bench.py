"""What tests of the bus share: how long they wait, and for what."""

import sys
import time
from collections.abc import Callable
from pathlib import Path

from cmr.bus.bus import Bus
from cmr.bus.messages import Received

PATIENCE = 60.0  # s until something that must happen is given up: a machine may be busy, and compile first


def receive_until(bus: Bus, enough: Callable[[list[Received]], bool]) -> list[Received]:
    """Return all that arrives on a bus until it is enough."""
    received: list[Received] = []
    deadline = time.monotonic() + PATIENCE
    while not enough(received):
        assert time.monotonic() < deadline, f"only {received[-5:]} arrived"
        received += bus.receive(0.1)
    return received


def our_command(name: str) -> str:
    """Return the path of an installed command."""
    return str(Path(sys.executable).parent / name)
