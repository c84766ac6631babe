"""What is run beside what: a lane leaves out the files that have nothing of it, and no others."""

from pathlib import Path

import pytest

from tests.support.lanes import LANES, further, has_none_of
from tests.support.project import PROJECT


@pytest.mark.parametrize("lane", LANES)
def test_a_lane_leaves_out_what_has_nothing_of_it(lane: str, tmp_path: Path) -> None:
    of_it, of_another = tmp_path / "test_one.py", tmp_path / "test_other.py"
    of_it.write_text(f"pytestmark = [pytest.mark.slow, pytest.mark.{lane}]\n")
    of_another.write_text("pytestmark = pytest.mark.slow\n")
    assert not has_none_of(lane, of_it)
    assert has_none_of(lane, of_another)
    assert has_none_of(f"{lane} and not further", of_another)


@pytest.mark.parametrize(
    "expression", ["", "slow", "not real_time and not waits", "real_time or waits", "waits and not real_time and slow"]
)
def test_any_other_expression_leaves_out_no_file(expression: str) -> None:
    assert not has_none_of(expression, Path(__file__))


def test_every_test_of_a_lane_is_marked_in_its_own_file() -> None:
    """Else the lane would leave it out: a mark that is imported, or that a conftest.py adds, is not seen."""
    for path in (PROJECT / "tests").rglob("*.py"):
        text = path.read_text("utf-8")
        here = path in (Path(__file__), PROJECT / "tests/support/lanes.py")  # whose `further` is seen where it is used
        if not here and any(f"mark.{lane}" in text for lane in LANES):
            assert path.name.startswith("test_"), path
            assert all(f"pytest.mark.{lane}" in text for lane in LANES if f"mark.{lane}" in text), path


def test_a_parameter_that_is_a_further_one_is_of_that_lane(tmp_path: Path) -> None:
    (seed,) = further(3)
    assert (seed.values, [mark.name for mark in seed.marks]) == ((3,), ["further"])
    file = tmp_path / "test_it.py"
    file.write_text('@pytest.mark.parametrize("seed", [1, *further(2, 3)])\n')
    assert not has_none_of("further", file)
    assert has_none_of("waits", file)
