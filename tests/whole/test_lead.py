"""cmr demo --lead: a script takes the place of the person; emulated robots follow the virtual one that it leads."""

import re
from pathlib import Path

import pytest

from tests.support.demo import demonstrated

pytestmark = pytest.mark.waits
PATIENCE = 240.0  # s


def test_emulated_robots_follow_the_robot_that_is_led(tmp_path: Path) -> None:
    script = "ahead 4, ahead-left 2, rest 2"
    output = demonstrated(tmp_path / "run", "--lead", "--script", script, patience=PATIENCE)
    found = re.search(r"led for (\S+) m; behind it drove robot 0 (\S+) m, robot 1 (\S+) m", output)
    assert found is not None, output
    led, first, second = map(float, found.groups())
    assert led == pytest.approx(6.0 * 0.3, rel=0.15)
    assert min(first, second) > 0.6 * led
    assert (tmp_path / "run" / "run.lcm").stat().st_size > 100_000
