"""First-order changes of the white errors with the parameters, represented by the products of the changes.

The columns are the white errors themselves, then their changes per step of a free parameter, on switching off a
selected effect, and on switching on a trial.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cmr.recordings.signal import Floats

RIDGE = 1e-9  # of a column's square: keeps collinear columns solvable


@dataclass(frozen=True)
class Left:
    """Trials (t) beside refitted parameters: products (t, t) and pulls (t,) of their orthogonal parts.

    `squares` is the residual sum of squares without any trial.
    """

    normal: Floats
    pulls: Floats
    squares: float


@dataclass(frozen=True)
class Linear:
    """Products (m, m) of m columns: errors, `free` parameters with their `steps`, effects switched `off`, trials."""

    products: Floats
    free: tuple[str, ...]
    steps: Floats
    off: tuple[str, ...]

    @cached_property
    def sizes(self) -> Floats:
        """The sum of the squares of each trial, (t,)."""
        return np.diag(self.products)[self._first :].copy()

    @property
    def _first(self) -> int:
        return 1 + len(self.free) + len(self.off)

    def beside(self, keep: Sequence[str], leaving: Sequence[str]) -> Left:
        """Return the trials' orthogonal parts when effects in `leaving` are removed and the parameters to `keep`
        refitted.
        """
        columns = self._columns(keep)
        errors, trials = self._errors(leaving), np.arange(self._first, len(self.products))
        pulls = self.products @ errors
        factor = self._solved(columns, np.column_stack([self.products[np.ix_(columns, trials)], pulls[columns]]))
        along, own = factor[:, :-1], factor[:, -1]
        mixed = self.products[np.ix_(trials, columns)]
        return Left(
            self.products[np.ix_(trials, trials)] - mixed @ along,
            pulls[trials] - mixed @ own,
            float(errors @ pulls - pulls[columns] @ own),
        )

    def step(
        self, keep: Sequence[str], leaving: Sequence[str], trials: Sequence[int], shares: Sequence[float]
    ) -> Floats:
        """Return the changes of the parameters to `keep` when these shares of trials are added, in their units."""
        columns, errors = self._columns(keep), self._errors(leaving)
        for number, share in zip(trials, shares, strict=True):
            errors[self._first + number] += share
        pulls = self.products[columns] @ errors
        return np.asarray(-self._solved(columns, pulls) * self.steps[columns - 1])

    def _columns(self, keep: Sequence[str]) -> np.typing.NDArray[np.int64]:
        return np.array([1 + self.free.index(name) for name in keep], np.int64)

    def _errors(self, leaving: Sequence[str]) -> Floats:
        """Return the linear combination of columns that gives the white errors without some effects."""
        result = np.zeros(len(self.products))
        result[0] = 1.0
        for name in leaving:
            result[1 + len(self.free) + self.off.index(name)] = 1.0
        return result

    def _solved(self, columns: np.typing.NDArray[np.int64], right: Floats) -> Floats:
        normal = self.products[np.ix_(columns, columns)]
        ridge = RIDGE * np.diag(normal) + np.finfo(np.float64).tiny
        return np.asarray(np.linalg.solve(normal + np.diag(ridge), right))
