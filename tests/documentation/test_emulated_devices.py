"""The page of emulated controllers says what they understand."""

import sys

from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from documentation.emulated_devices import PAGE, WITH_EFFECT, document

from robot_driver.emulator.boards.roboclaw_commands import SETTINGS


def test_the_page_is_that_of_the_tables() -> None:
    assert PAGE.read_text(encoding="utf-8") == document(), "run scripts/write_emulated_devices"


def test_settings_with_an_effect_are_settings() -> None:
    assert set(SETTINGS) >= WITH_EFFECT
