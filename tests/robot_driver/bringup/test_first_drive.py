"""What bring-up wrote is enough: the figure-eight calibrates at the first try."""

import sys
from pathlib import Path

import pytest

from tests.robot_driver.bringup.robots import robot, verdict
from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from studies.first_drive import LONGEST, correct_poses, drive_and_calibrate, out_of_bounds

pytestmark = pytest.mark.slow


@pytest.mark.further  # ten seconds; scripts/study_bringup --drives does it with many
def test_the_figure_eight_of_a_robot_that_was_brought_up_calibrates_at_the_first_try(tmp_path: Path) -> None:
    """Wired wrongly, data sheet in pulses, gyro upside down, poses mirrored (corrected as asked), late and off."""
    case = robot("mirrored", "late", "offset", flags=("motors", "left", "left_against"), gyro=-1.0, stated=512)
    outcome = case.bringup.run_directly(tmp_path)
    assert verdict(case, outcome)[0] == "right", outcome.text
    case, outcome = correct_poses(case, outcome, tmp_path)
    assert all(result.decided for result in outcome.results), outcome.text
    assert outcome.seconds < LONGEST
    result = drive_and_calibrate(case, outcome, tmp_path)
    assert out_of_bounds(case, result) == []
