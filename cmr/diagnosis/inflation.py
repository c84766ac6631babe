"""How much larger scores of effects that explain nothing are than chance would have them.

It stands for whatever is not quite as assumed (genomic control; Devlin and Roeder, Biometrics 55, 1999). What is not as
assumed of the wheels says nothing of gyro and pose: effects that show in these have an inflation of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmr.recordings.signal import Floats, Mask

ASIDE, ASIDE_OF_BODY = 6, 3  # best trials that do not count
FEWEST = 10  # others that must be left
LEFT = 0.1  # of a trial's size that must be its own to count
NOTHING = 1e-6  # white errors squared; a trial that changes less says nothing
MEDIAN_OF_CHI2 = 0.4549  # with one degree of freedom


@dataclass(frozen=True)
class Inflation:
    """The inflation of `all` effects, at least 1, and that of those, by name, which show in gyro and pose: `body`."""

    all: float
    of_body: float = 1.0
    body: frozenset[str] = frozenset()

    def of(self, effect: str) -> float:
        """Return the inflation of an effect's score."""
        return min(self.of_body, self.all) if effect in self.body else self.all

    def at_least(self, least: float) -> "Inflation":
        """Return the inflation raised to this, of all effects."""
        return Inflation(max(self.all, least), max(self.of_body, least), self.body)


def inflation_of(effects: Sequence[str], moves: Floats, rest: Floats, wheels: Mask) -> Inflation:
    """Return the inflation that trials of `effects` show; `wheels` (n,) tells which white errors are of wheels.

    Their `moves` (n, trials) and the white errors `rest` (n,) are free of what the model itself explains.
    """
    sizes = np.einsum("nc,nc->c", moves, moves)
    of_wheels = np.einsum("nc,nc->c", moves[wheels], moves[wheels])
    body = of_wheels < 0.5 * sizes
    elsewhere = {effect for effect, inside in zip(effects, body, strict=True) if not inside}
    return Inflation(
        _usual(moves, rest, ASIDE),
        _usual(moves[:, body], rest, ASIDE_OF_BODY),
        frozenset(set(effects) - elsewhere),
    )


def _usual(moves: Floats, rest: Floats, aside: int) -> float:
    """Return the median score over that of chance, once the few best trials have explained their share."""
    normal, pulls = moves.T @ moves, moves.T @ rest
    before = np.diag(normal).copy()
    for _ in range(min(aside, len(before))):
        sizes, free = np.diag(normal), np.diag(normal) > NOTHING
        drops = np.where(free, pulls**2 / np.where(free, sizes, 1.0), 0.0)
        best = int(np.argmax(drops))
        share = normal[:, best] / max(sizes[best], NOTHING)
        pulls = pulls - share * pulls[best]
        normal = normal - np.outer(share, normal[best])
    free = np.diag(normal) > np.maximum(NOTHING, LEFT * before)
    if np.count_nonzero(free) < FEWEST:
        return 1.0
    return max(1.0, float(np.median(pulls[free] ** 2 / np.diag(normal)[free])) / MEDIAN_OF_CHI2)
