"""cmr demo --lead: a script takes the place of the person; emulated robots follow the virtual one that it leads."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.waits
PATIENCE = 240.0  # s


def test_emulated_robots_follow_the_robot_that_is_led(tmp_path: Path) -> None:
    script = "ahead 4, ahead-left 2, rest 2"
    command = [sys.executable, "-m", "cmr", "demo", "--lead", "--script", script, "--out", str(tmp_path / "run")]
    demo = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        output, _ = demo.communicate(timeout=PATIENCE)
    finally:
        demo.send_signal(signal.SIGTERM)
    assert demo.returncode == 0, output
    found = re.search(r"led for (\S+) m; behind it drove robot 0 (\S+) m, robot 1 (\S+) m", output)
    assert found is not None, output
    led, first, second = map(float, found.groups())
    assert led == pytest.approx(6.0 * 0.3, rel=0.15)
    assert min(first, second) > 0.6 * led
    assert (tmp_path / "run" / "run.lcm").stat().st_size > 100_000
