"""Two cmr-sim on two buses share a world across a network that loses, delays and reorders, and is cut for a while."""

import math
from pathlib import Path

import numpy as np
import pytest

from tests.support.two_buses import DELAY, GONE, OWNED, ROUNDING, watch_two_buses

pytestmark = pytest.mark.waits

CUT = (2.0, 5.5)  # s
SECONDS = 10.0
COMPLAINTS = ("Another cmr-sim publishes", "clock")  # of robots that are doubled, or of another time


def test_over_a_lossy_network_that_is_cut_and_joined_again_no_robot_is_lost_or_doubled(tmp_path: Path) -> None:
    record = watch_two_buses(tmp_path, SECONDS, CUT)
    everybody = OWNED[0] | OWNED[1]
    assert set(record.sightings) == {(bus, robot_id) for bus in (0, 1) for robot_id in everybody}
    for bus, own in enumerate(OWNED):
        for robot_id in everybody:
            silent = record.longest_silence(bus, robot_id)
            assert silent <= GONE + record.paused + (0.0 if robot_id in own else CUT[1] - CUT[0])
    assert [record.doubled(robot_id) for robot_id in sorted(everybody)] == [0] * len(everybody)
    for robot_id in everybody:
        assert record.largest_excess(robot_id) <= ROUNDING
        assert DELAY / 2.0 <= np.median(record.ages(robot_id)) <= 0.1 + record.paused
    assert not any(wrong in sentence for sentence in record.said for wrong in COMPLAINTS), record.said
    assert record.lost
    # Who follows a robot of the other simulator has seen it through the network.
    for follower, leader in ((12, 20), (22, 10)):
        here, there = (record.sightings[0, robot_id][-1] for robot_id in (follower, leader))
        assert math.hypot(here.x - there.x, here.y - there.y) < 1.0
        assert len({round(s.x, 2) for s in record.sightings[0, follower]}) > 5
