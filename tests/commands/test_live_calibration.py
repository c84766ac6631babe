"""What cmr-calibrate computes beside a drive gives way to it; what the drive waits for does not."""

import os
import threading
import time

import pytest

from cmr.commands.calibrate import Work
from cmr.priority import COMPUTING

PATIENCE = 10.0  # s


@pytest.mark.parametrize("while_driving", [False, True])
def test_only_what_is_computed_while_driving_gives_way(while_driving: bool) -> None:
    own, found = os.getpriority(os.PRIO_PROCESS, 0), list[int]()
    work = Work()
    work.begin(
        lambda: found.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id())), while_driving=while_driving
    )
    until = time.monotonic() + PATIENCE
    while not work.idle and time.monotonic() < until:
        time.sleep(0.01)
    assert found == [COMPUTING if while_driving else own]
