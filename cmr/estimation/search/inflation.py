"""The factor by which scores of absent effects exceed chance (genomic control).

    inflation = max(1, median_c(drop_c) / MEDIAN_OF_CHI2)

over the trials c that remain after projecting out the ASIDE best. It covers violated assumptions. Those about the
wheels do not concern gyro and pose: effects visible in these have an inflation of their own.

Reference: B. Devlin and K. Roeder, Biometrics 55, 1999.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmr.recordings.signal import Floats, Mask

ASIDE, ASIDE_OF_BODY = 6, 3  # best trials that do not count
FEWEST = 10  # others that must remain
LEFT = 0.1  # of a trial's size that must be orthogonal to the model
NOTHING = 1e-6  # white errors squared; a trial with a smaller change has no effect
MEDIAN_OF_CHI2 = 0.4549  # with one degree of freedom

Indices = np.typing.NDArray[np.int64]


@dataclass(frozen=True)
class Inflation:
    """The inflation of `all` effects, at least 1, and that of those, by name, visible in gyro and pose: `body`."""

    all: float
    of_body: float = 1.0
    body: frozenset[str] = frozenset()

    def of(self, effect: str) -> float:
        """Return the inflation of an effect's score."""
        return min(self.of_body, self.all) if effect in self.body else self.all

    def at_least(self, least: float) -> "Inflation":
        """Return the inflation raised to this value, for all effects."""
        return Inflation(max(self.all, least), max(self.of_body, least), self.body)


@dataclass(frozen=True)
class Beside:
    """Sums over all white errors of c traces, after projecting out the model's own.

    The sums are those of products of traces with each other, `normal` (c, c), with the residuals, `pulls` (c,), and of
    squared traces in the wheels, `of_wheels` (c,).
    """

    normal: Floats
    pulls: Floats
    of_wheels: Floats

    @classmethod
    def of(cls, white: Floats, free: int, wheels: Mask) -> "Beside":
        """Return the sums from `white` (n, 1 + free + c): errors, changes by the model's parameters, and by the trials.

        `wheels` (n,) says which errors are of wheels.
        """
        rest, basis = left_by(white, free)
        moves, along = white[:, 1 + free :], basis.T @ white[:, 1 + free :]
        in_wheels, part = basis[wheels], moves[wheels]
        own, mixed = np.einsum("nc,nc->c", part, part), along * (in_wheels.T @ part)
        return cls(
            normal=(white.T @ white)[1 + free :, 1 + free :] - along.T @ along,
            pulls=rest @ moves,
            of_wheels=own - np.sum(2.0 * mixed - along * (in_wheels.T @ in_wheels @ along), axis=0),
        )

    @property
    def sizes(self) -> Floats:
        """The sums of the squares of the trials' changes, (c,)."""
        return np.diag(self.normal)

    def only(self, numbers: Indices) -> "Beside":
        """Return the same for some of the traces."""
        return Beside(self.normal[np.ix_(numbers, numbers)], self.pulls[numbers], self.of_wheels[numbers])


def left_by(white: Floats, free: int) -> tuple[Floats, Floats]:
    """Return the white errors (n,) orthogonal to a model's traces, and an orthonormal basis (n, free) of these.

    The first columns of `white` are the errors and the model's traces.
    """
    basis, _ = np.linalg.qr(white[:, 1 : 1 + free])
    return white[:, 0] - basis @ (basis.T @ white[:, 0]), basis


def inflation_of(effects: Sequence[str], beside: Beside) -> Inflation:
    """Return the inflation from trials of `effects`, one trace each."""
    body = beside.of_wheels < 0.5 * beside.sizes
    elsewhere = {effect for effect, inside in zip(effects, body, strict=True) if not inside}
    return Inflation(
        _usual(beside, ASIDE),
        _usual(beside.only(np.flatnonzero(body)), ASIDE_OF_BODY),
        frozenset(set(effects) - elsewhere),
    )


def _usual(beside: Beside, aside: int) -> float:
    """Return the median score relative to chance, after projecting out the few best trials."""
    normal, pulls = beside.normal, beside.pulls
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
