"""The noise of a signal: the predictable part of its residuals, and the innovations.

Residuals of a free-running simulation are autocorrelated: pose trackers smooth, and slip errors persist. Least squares
is efficient, and its standard deviations are correct, on the innovations; so residuals and their derivatives are
filtered by the autoregression that predicts each residual from the previous ones (generalised least squares; Cochrane
and Orcutt, J. Am. Stat. Assoc. 44, 1949).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.recording import Floats

ORDER = 4  # number of previous residuals used; more cost data and add little
# A series needs this many samples for each coefficient: in shorter ones a model that does not fit looks like noise that
# grows, and whitening would remove what there is to learn.
SAMPLES_PER_ORDER = 50
BATCHES = 16  # per series; each then lasts some seconds of a figure-eight, longer than disturbances last
CHANCE = 2.0  # standard deviations by which batch means may scatter more than white noise before it counts
LONGEST_INTERVAL = 1.5  # usual intervals; after a longer one a sample has no history
LEAST_FREEDOM = 0.2  # lower limit for the share of independent residuals
TINY = 1e-300
SMALLEST_NOISE = 1e-12  # keeps perfect, made-up data from dividing by zero


@dataclass(frozen=True)
class Series:
    """Residuals of one signal, in its unit, at `times` [s] (n,), with their derivatives.

    `rows` has shape (1 + k, n): the residuals, then the derivatives by the unknowns `columns` (k,); all others are 0.
    """

    rows: Floats
    columns: tuple[int, ...]
    times: Floats

    @property
    def residuals(self) -> Floats:
        """The residuals (n,)."""
        return np.asarray(self.rows[0])


@dataclass(frozen=True)
class Noise:
    """The noise of one signal: its autoregression, shape (order,), and the size of the innovations."""

    coefficients: Floats
    size: float = 1.0

    def whiten(self, rows: Floats, times: Floats) -> Floats:
        """Return the innovations of rows of shape (m, n), in units of the noise, at times with complete history."""
        order = len(self.coefficients)
        new = rows[:, order:] / self.size
        for lag, coefficient in enumerate(self.coefficients, start=1):
            new -= (coefficient / self.size) * rows[:, order - lag : order - lag + new.shape[1]]
        return np.asarray(new[:, _with_past(times, order)])

    def products(self, series: Series) -> Floats:
        """Return W W^T, shape (m, m), of the innovations W of all rows of a series."""
        from cmr.calibration.products import add_products

        weights = np.concatenate([[1.0], -self.coefficients]) / self.size
        count = len(series.rows)
        products = np.zeros((count, count))
        add_products(series.rows, _with_past(series.times, len(self.coefficients)), weights, products)
        return products + np.tril(products, -1).T


def noise_of(series: Sequence[Series], order: int = ORDER, unknowns: int = 0) -> Noise:
    """Estimate the noise of a signal from its residuals, to which `unknowns` were fitted."""
    coefficients = _autoregression(series, min(order, _longest_order(series)))
    new = [Noise(coefficients).whiten(one.rows[:1], one.times)[0] for one in series]
    count = max(sum(len(values) for values in new), 1)
    size = _size(new, count)
    total = sum(_squares(one.residuals) for one in series) / sum(len(one.residuals) for one in series)
    # This many independent residuals would be as informative about a slow cause; unknowns use them up.
    independent = count * min(max(total * (1.0 - float(np.sum(coefficients))) ** 2 / max(size**2, TINY), 0.0), 1.0)
    freedom = max(1.0 - unknowns / max(independent, 1.0), LEAST_FREEDOM)
    return Noise(coefficients, max(size / float(np.sqrt(freedom)), SMALLEST_NOISE))


def _longest_order(series: Sequence[Series]) -> int:
    """Return the order that series of this length support; long series count for more."""
    lengths = np.array([len(one.residuals) for one in series], dtype=float)
    return int(np.sum(lengths**2) / np.sum(lengths)) // SAMPLES_PER_ORDER


def _with_past(times: Floats, order: int) -> NDArray[np.bool_]:
    """Return which samples from number `order` on follow that many others without a gap."""
    if order == 0 or len(times) <= order:
        return np.ones(max(len(times) - order, 0), dtype=bool)
    interval = np.diff(times)
    late = np.concatenate([[0], np.cumsum(interval > LONGEST_INTERVAL * np.median(interval))])
    return np.asarray(late[order:] == late[:-order])


def _autoregression(series: Sequence[Series], order: int) -> Floats:
    """Return the coefficients that predict best, by least squares over all series, each residual from those before."""
    normal, right = np.zeros((order, order)), np.zeros(order)
    if order == 0:
        return right
    for one in series:
        if len(one.times) <= order:  # too short to tell
            continue
        rows, past = one.residuals, _with_past(one.times, order)
        lagged = np.array([rows[order - lag : len(rows) - lag][past] for lag in range(1, order + 1)])
        normal += lagged @ lagged.T
        right += lagged @ rows[order:][past]
    return _stable(np.linalg.pinv(normal) @ right)


def _stable(coefficients: Floats) -> Floats:
    """Return the coefficients, shrunk so far that the prediction is stable."""
    order = len(coefficients)
    companion = np.vstack([coefficients, np.eye(order)[:-1]])
    growth = max(float(np.max(np.abs(np.linalg.eigvals(companion)))), 1.0)
    return np.asarray(coefficients / growth ** np.arange(1, order + 1))


def _size(new: Sequence[Floats], count: int) -> float:
    """Return the size of the noise, enlarged for remaining slow disturbances.

    The means of batches of n independent residuals scatter with a variance n times smaller than the residuals do. If
    they scatter more than expected, the noise is enlarged by that ratio (method of batch means).
    """
    batches = [batch for values in new for batch in np.array_split(values, min(BATCHES, max(len(values), 1)))]
    white = sum(_squares(values) for values in new) / count
    slow = sum(float(np.sum(batch)) ** 2 for batch in batches) / count
    chance = white * (1.0 + CHANCE * np.sqrt(2.0 / len(batches)))
    return float(np.sqrt(slow if slow > chance else white))


def _squares(values: Floats) -> float:
    """Return the sum of squares; a dot product would start threads for so little."""
    return float(np.einsum("i,i", values, values))
