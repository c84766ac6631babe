"""The page on bringing up a robot shows what bring-up says, and its badly wired robot is brought up."""

import math
from pathlib import Path

import pytest

from cmr.parameters.file import load as load_parameters
from robot_driver.bringup import STEPS
from robot_driver.bringup.motors import CHOICES
from robot_driver.bringup.poses_found import PosesFound
from robot_driver.emulator.settings import load_settings
from robot_driver.simulated.bringing_up import Person, SimulatedBringup
from tests.support.documentation_blocks import DOCS, blocks_of

pytestmark = pytest.mark.slow

PAGE = DOCS / "how_to" / "your_robot_in_an_hour.md"


def test_the_robot_of_the_page_is_brought_up_and_says_what_the_page_shows(tmp_path: Path) -> None:
    written = next(block.text for block in blocks_of(PAGE) if block.text.startswith("mounting:"))
    (tmp_path / "settings.yaml").write_text(written, "utf-8")
    settings = load_settings(tmp_path / "settings.yaml")
    person = Person(0.04, 0.161, 2048, measures_stop=False)
    outcome = SimulatedBringup(settings, person).run_directly(tmp_path)
    assert all(result.decided for result in outcome.results), outcome.text
    driver = outcome.known.driver
    assert [driver[name] for name in ("swap", "invert_left", "invert_right", "swap_encoders")] == [
        True,
        True,
        False,
        False,
    ]
    assert driver["invert_gyro"] is True
    assert outcome.known.found["poses_mirrored"] is True
    assert outcome.known.found["poses_metre"] == 1000.0
    assert load_parameters(tmp_path / "robot_0.yaml").has("wheel_radius", "base_width", "k1", "k2_over_k3")
    shown = next(block.text for block in blocks_of(PAGE) if block.text.startswith("The motor of the first"))
    said = [outcome.text, *(f"{choice.key:5}  {choice.text}" for choice in CHOICES)]
    for line in shown.splitlines():
        assert any(line.strip() in text for text in said), line


def test_the_page_has_every_step_and_every_correction() -> None:
    text = PAGE.read_text("utf-8")
    assert all(f"| `{step}` |" in text for step in STEPS)
    wrong = PosesFound(1000.0, True, True, math.pi / 2, 0.05, 0.0, 0.3)
    for sentence in [*wrong.corrections(0), *PosesFound(vertical="y").corrections(0)]:
        assert f"| {sentence.split(' (')[0].split(':')[0].split(' and ')[0]}" in text, sentence
