"""Least squares for a few unknowns, in plain Python, as a robot's computer has no NumPy. Numbers may be complex."""

from collections.abc import Sequence

TINY = 1e-12  # share of the largest pivot, below which the system counts as singular


class Undetermined(Exception):  # noqa: N818 - a finding
    """The rows do not determine all unknowns."""


def least_squares(rows: Sequence[Sequence[complex]], values: Sequence[complex]) -> list[complex]:
    """Return the least-squares solution, shape (n,), of rows, shape (m, n), and values, shape (m,).

    Raises Undetermined.
    """
    unknowns = range(len(rows[0]))
    normal = [[sum(row[i].conjugate() * row[j] for row in rows) for j in unknowns] for i in unknowns]
    right = [sum(row[i].conjugate() * value for row, value in zip(rows, values, strict=True)) for i in unknowns]
    return solve(normal, right)


def solve(matrix: list[list[complex]], right: list[complex]) -> list[complex]:
    """Return the solution of a square system, by elimination with pivots; changes both. Raises Undetermined."""
    count = len(right)
    largest = max((abs(value) for row in matrix for value in row), default=0.0)
    for column in range(count):
        pivot = max(range(column, count), key=lambda row: abs(matrix[row][column]))
        if abs(matrix[pivot][column]) <= TINY * largest:
            raise Undetermined
        matrix[column], matrix[pivot] = matrix[pivot], matrix[column]
        right[column], right[pivot] = right[pivot], right[column]
        for row in range(column + 1, count):
            factor = matrix[row][column] / matrix[column][column]
            matrix[row] = [a - factor * b for a, b in zip(matrix[row], matrix[column], strict=True)]
            right[row] -= factor * right[column]
    solution = [0j] * count
    for row in reversed(range(count)):
        known = sum(matrix[row][column] * solution[column] for column in range(row + 1, count))
        solution[row] = (right[row] - known) / matrix[row][row]
    return solution
