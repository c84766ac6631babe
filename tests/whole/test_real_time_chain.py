"""Two robots as real processes on a real bus, in real time: what is hidden in them is named, and nothing else.

Emulators and drivers keep time to milliseconds themselves and stamp what they measure, so a machine that stands still
now and then is no excuse here.
"""

from dataclasses import replace
from pathlib import Path

import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.recordings import Recording
from tests.hidden_effects.chain import DEFAULT, EIGHTS, ChainCase, hidden_robot
from tests.hidden_effects.real_time import drive_in_real_time

# A minute and a half, most of it driving. Beside it CI computes, at idle priority.
pytestmark = pytest.mark.waits

DELAY = 0.04  # s


def test_a_late_robot_and_the_default_one_are_told_apart_and_nothing_untrue_is_named(tmp_path: Path) -> None:
    cases = [ChainCase(effect, "roboclaw+dsp3000", EIGHTS, seed=1) for effect in ("command_delay", DEFAULT)]
    late, default = (hidden_robot(case, case.random) for case in cases)
    effects = {**late.settings.effects, "command_delay": DELAY}
    late = late._replace(settings=replace(late.settings, effects=effects))
    log, _ = drive_in_real_time(cases, tmp_path, [late, default])
    named = [{effect.name for effect in diagnose(Recording.read(log, number)).effects} for number in range(len(cases))]
    assert "command_delay" in named[0]
    for case, names in zip(cases, named, strict=True):
        assert names <= case.there, f"{case.effect}: {sorted(names - case.there)} are not there"
