"""Which files of tests have a part in a lane (CONTRIBUTING.md, Test)."""

from pathlib import Path

LANES = ("hidden_effects", "real_time", "waits")  # those that few files have tests of


def has_none_of(lane: str, path: Path) -> bool:
    """Return whether a file of tests has none of a lane; False where the lane is another expression of pytest's -m."""
    return lane in LANES and path.name.startswith("test_") and f"pytest.mark.{lane}" not in path.read_text("utf-8")
