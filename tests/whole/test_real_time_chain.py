"""A robot as real processes on a real bus, in real time: what is hidden in it is named, and nothing else.

Emulators and drivers keep time to milliseconds themselves and stamp what they measure, so a machine that stands still
now and then is no excuse here. Of the emulator's default robot test_demo.py asks the same.
"""

from dataclasses import replace
from pathlib import Path

import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.recordings import Recording
from tests.hidden_effects.chain import EIGHTS, ChainCase, hidden_robot
from tests.hidden_effects.real_time import drive_in_real_time

# A minute and a half, most of it driving. Beside it CI computes, at idle priority.
pytestmark = pytest.mark.waits

DELAY = 0.04  # s


def test_late_commands_are_named_and_nothing_untrue_beside_them(tmp_path: Path) -> None:
    case = ChainCase("command_delay", "roboclaw+dsp3000", EIGHTS, seed=1)
    robot = hidden_robot(case, case.random)
    effects = {**robot.settings.effects, "command_delay": DELAY}
    robot = robot._replace(settings=replace(robot.settings, effects=effects))
    log, _ = drive_in_real_time([case], tmp_path, [robot])
    named = {effect.name for effect in diagnose(Recording.read(log, 0)).effects}
    assert "command_delay" in named
    assert named <= case.there, f"{sorted(named - case.there)} are not there"
