"""Separation: closed forms of two and three columns."""

import numpy as np
import pytest

from cmr.investigation.separation import (
    BELIEF,
    STAND_IN,
    Columns,
    against,
    own,
    progress,
    projected,
    scores,
    separations,
)


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


def test_data_speak_against_an_effect_by_its_size_less_what_they_show_of_it() -> None:
    """Errors r that hold a share s of a column X of length d: 2 log odds d^2 - 2 s d^2, of one sign d^2 + 2 s d^2."""
    column, share = np.array([3.0, 4.0]), 0.2
    errors = share * column
    columns = Columns(0, {"either": (0,)})
    information, pulls = np.array([[25.0]]), np.array([column @ errors])
    assert against(information, pulls, columns) == pytest.approx([BELIEF * (25.0 - 2.0 * share * 25.0)])
    assert against(information, pulls, columns, ["either"]) == pytest.approx([BELIEF * (25.0 + 2.0 * share * 25.0)])


def test_what_takes_longest_counts_most() -> None:
    """Of two effects, one needs 10 s of its best movement, one 2 s: T^2 / 2 falls by 10 and by 2 a second."""
    gained = np.array([[2.0, 0.0], [0.0, 4.0], [0.0, 0.0]])
    worth = progress(gained, np.array([20.0, 4.0]), np.array([1.0, 2.0, 1.0]))
    assert worth == pytest.approx([10.0, 2.0, 0.0])
    assert progress(gained, np.array([np.inf, 4.0]), np.ones(3)) == pytest.approx([0.0, 1.0, 0.0])
