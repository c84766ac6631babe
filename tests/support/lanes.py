"""Which files of tests have a part in a lane (CONTRIBUTING.md, Test)."""

from pathlib import Path

LANES = ("further", "hidden_effects", "real_time", "waits")  # those that few files have tests of


def has_none_of(wanted: str, path: Path) -> bool:
    """Return whether a file of tests has none of a lane, alone or without a part of it; `wanted` is pytest's -m.

    False of any other expression: pytest finds out by itself.
    """
    lane, _, rest = wanted.partition(" and not ")
    known = lane in LANES and (not rest or rest in LANES)
    return known and path.name.startswith("test_") and f"pytest.mark.{lane}" not in path.read_text("utf-8")
