"""What trackers do wrong becomes no pose instead of a wrong one: each misbehaviour, in each of three protocols."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product

import pytest

pytest.importorskip("natnet", reason="the extra [tracker] is not installed")
pytest.importorskip("qtm_rt", reason="the extra [tracker] is not installed")
from tests.support.lanes import further
from tests.support.trackers.bench import KINDS, Bench
from tests.support.trackers.motion import Fault, faults

pytestmark = pytest.mark.slow
NAMES = [fault.name for fault in faults()]
EACH = [
    (name, KINDS[number % len(KINDS)]) for number, name in enumerate(NAMES)
]  # protocols in turn: they share one watch
RATE = 120.0  # Hz
SECONDS = 9.0
REPORTED = {
    "lost": "lost",
    "frozen": "frozen",
    "swapped": "in the place of robot 1",
    "flipped": "flipped by 180 degrees",
    "jumps": "jumped by",
    "outage": "No frame from the tracker",
}


@contextmanager
def connected(kind: str, **options: object) -> Iterator[Bench]:
    bench = Bench(kind, bodies=12, rate=RATE, **options)  # type: ignore[arg-type]
    try:
        bench.connect()
        yield bench
    finally:
        bench.close()


def fault(name: str) -> Fault:
    return next(one for one in faults() if one.name == name)


@pytest.mark.parametrize(
    ("name", "kind"), [*EACH, *further(*(pair for pair in product(NAMES, KINDS) if pair not in EACH))]
)
def test_no_wrong_pose_is_published_and_good_ones_come_again_within_a_second(kind: str, name: str) -> None:
    with connected(kind) as bench:
        score = bench.run(SECONDS, fault(name))
    assert score.wrong == 0
    assert score.published > 0.5 * score.good
    assert score.recovery <= 1.0
    assert score.share_withheld <= 0.05  # of nine seconds and twelve robots; the study has the full size
    assert max(map(abs, score.stamp_errors)) <= 0.001
    if name in REPORTED:
        assert any(REPORTED[name] in report for report in score.reports), score.reports
    if name == "outage":
        assert score.reported_after is not None
        assert score.reported_after <= 0.5


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_tracker_loses_no_pose(kind: str) -> None:
    with connected(kind, has_gyros=False) as bench:
        score = bench.run(5.0)
    assert (score.wrong, score.withheld) == (0, 0)
