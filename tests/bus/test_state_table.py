"""Robots keep their rows in a table of states, however many there come to be."""

import numpy as np

from cmr.bus.state_table import FIRST_ROOM, MOST_SETS_REMEMBERED, NEVER, StateTable


def numbers(*values: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.array(values, np.int64)


def test_a_robot_keeps_its_row_and_its_state_when_the_table_grows() -> None:
    table = StateTable(2)
    [row] = table.rows(numbers(7), numbers(1)).tolist()
    table.state[:, row], table.utime[row] = (1.0, 2.0), 5
    ids = np.arange(100, 100 + 3 * FIRST_ROOM)
    rows = table.rows(ids, np.ones_like(ids))
    assert len({row, *rows.tolist()}) == 1 + 3 * FIRST_ROOM
    assert table.row(7, 1) == row
    assert (table.state[:, row].tolist(), table.utime[row]) == ([1.0, 2.0], 5)
    assert table.robot_id[rows].tolist() == ids.tolist()
    assert set(table.utime[rows].tolist()) == {NEVER}
    assert np.isnan(table.state[:, rows]).all()


def test_the_same_robot_of_another_origin_has_another_row() -> None:
    table = StateTable(1)
    rows = table.rows(numbers(3, 3, 3), numbers(0, 1, 2))
    assert sorted(rows.tolist()) == [0, 1, 2]
    assert table.rows(numbers(3), numbers(1)).tolist() == [rows[1]]


def test_however_many_sets_of_robots_come_rows_are_the_same() -> None:
    table = StateTable(1)
    for first in range(2 * MOST_SETS_REMEMBERED):
        assert table.rows(numbers(first, first + 1), numbers(0, 0)).tolist() == [first, first + 1]
