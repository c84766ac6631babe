"""Separation: closed forms of two and three columns."""

import numpy as np
import pytest

from cmr.investigation.separation import BELIEF, STAND_IN, Columns, own, projected, scores, separations


def test_what_a_parameter_does_itself_does_not_separate() -> None:
    """A column along the parameter's own is projected off, one across it stays whole."""
    free, along, across = np.array([2.0, 0.0]), np.array([3.0, 0.0]), np.array([0.0, 4.0])
    white = np.stack([free, along, across], axis=1)
    columns = Columns(1, {"along": (1,), "across": (2,)})
    left = projected(white.T @ white, columns)
    assert own(left, columns) == pytest.approx([0.0, BELIEF * 16.0], abs=1e-6)


def test_a_rival_stands_in_up_to_three_usual_sizes() -> None:
    """S_ij of two columns at an angle is what the formula of the module says."""
    one, other = np.array([5.0, 0.0]), np.array([3.0, 4.0])
    white = np.stack([one, other], axis=1)
    columns = Columns(0, {"one": (0,), "other": (1,)})
    seen = separations(white.T @ white, columns)
    assert seen[0, 1] == pytest.approx(BELIEF * (25.0 - 15.0**2 / (25.0 + STAND_IN)))
    assert seen[0, 0] == pytest.approx(BELIEF * 25.0)


def test_the_same_mathematics_is_never_separated() -> None:
    """However much is driven, a rival with the same column takes all but its prior."""
    column = 100.0 * np.ones(50)
    white = np.stack([column, column], axis=1)
    seen = separations(white.T @ white, Columns(0, {"one": (0,), "other": (1,)}))
    assert seen[0, 1] < BELIEF * STAND_IN * 1.01
    assert seen[0, 0] > 1e5


def test_more_information_never_separates_less() -> None:
    """Further rows only add to S against nothing, and a candidate that adds nothing is worth nothing."""
    random = np.random.default_rng(0)
    white = random.standard_normal((40, 6))
    columns = Columns(2, {"a": (2,), "b": (3, 4), "c": (5,)})
    few, many = (separations(projected(w.T @ w, columns), columns) for w in (white[:20], white))
    assert np.all(np.diag(many) >= np.diag(few) - 1e-9)
    need = np.full((3, 3), 10.0)
    worth = scores(few, np.stack([few, many]), need, np.ones(3), np.ones(2))
    assert worth[0] == 0.0 < worth[1]
