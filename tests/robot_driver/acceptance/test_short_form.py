"""The short form of cmr accept: an honest robot keeps every promise, and drivers that break one are found out.

All ways in which a promise is broken, and honest robots on a busy computer: scripts/study_acceptance.
"""

from pathlib import Path

import pytest

from robot_driver.acceptance.findings import PASSED, PROMISES
from tests.support.accepted_robot import accept
from tests.support.sabotage import ALL, DEVICES, promise_of

pytestmark = pytest.mark.waits  # and makes a step again for which the computer was too busy


@pytest.mark.longest
def test_an_honest_robot_keeps_every_promise(tmp_path: Path) -> None:
    report = accept(tmp_path)
    assert report.verdicts == dict.fromkeys(PROMISES, PASSED), "\n".join(report.lines())


@pytest.mark.further
@pytest.mark.parametrize("way", ["11 warns of nothing", "12 locks nothing", "6 its device ignores silence"])
def test_a_promise_that_is_broken_is_found_out(tmp_path: Path, way: str) -> None:
    promise = promise_of(way)
    report = accept(tmp_path, way, wanted=[promise], break_device=DEVICES.get(way), hands=False)
    assert report.failed == [promise]


def test_each_promise_can_be_broken_in_three_ways() -> None:
    for promise in PROMISES:
        assert len([way for way in ALL if promise_of(way) == promise]) >= 3
