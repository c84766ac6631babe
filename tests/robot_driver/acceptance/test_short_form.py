"""The short form of cmr accept: an honest robot keeps every promise, and drivers that break one are found out.

All ways in which a promise is broken, and honest robots on a busy computer: scripts/study_acceptance.
"""

from pathlib import Path

import pytest

from robot_driver.acceptance.findings import PASSED, PROMISES
from tests.support.accepted_robot import accept
from tests.support.lanes import further
from tests.support.sabotage import ALL, DEVICES, promise_of

pytestmark = pytest.mark.waits  # and makes a step again for which the computer was too busy


# Each promise of the driver has tests of its own in tests/robot_driver. These four take seconds.
@pytest.mark.parametrize("wanted", [(8, 9, 11, 12), *further((tuple(PROMISES),))], ids=["some", "every"])
def test_an_honest_robot_keeps_its_promises(tmp_path: Path, wanted: tuple[int, ...]) -> None:
    report = accept(tmp_path, wanted=wanted)
    kept = {promise: verdict for promise, verdict in report.verdicts.items() if promise in wanted}
    assert kept == dict.fromkeys(wanted, PASSED), "\n".join(report.lines())


@pytest.mark.further  # what each is judged by: test_judges.py
@pytest.mark.parametrize("way", ["11 warns of nothing", "12 locks nothing", "6 its device ignores silence"])
def test_a_promise_that_is_broken_is_found_out(tmp_path: Path, way: str) -> None:
    promise = promise_of(way)
    report = accept(tmp_path, way, wanted=[promise], break_device=DEVICES.get(way), hands=False)
    assert report.failed == [promise]


def test_each_promise_can_be_broken_in_three_ways() -> None:
    for promise in PROMISES:
        assert len([way for way in ALL if promise_of(way) == promise]) >= 3
