"""Normal equations with shared unknowns and unknowns that belong to single segments.

The unknowns of different segments are not coupled, so they are eliminated segment by segment (Schur complement) and the
cost grows with the number of segments, not with its cube. Source: Triggs et al., Bundle Adjustment, 2000, section 6.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmr.recordings.recording import Floats


@dataclass
class NormalEquations:
    """J^T J and J^T r, summed over rows: `shared` unknowns first, then `own` ones of each segment.

    Shapes: normal (segments, shared + own, shared + own), right (segments, shared + own).
    """

    normal: Floats
    right: Floats
    shared: int
    cost: float = 0.0

    @classmethod
    def empty(cls, segments: int, shared: int, own: int) -> "NormalEquations":
        """Return the sum of no rows."""
        size = shared + own
        return cls(np.zeros((segments, size, size)), np.zeros((segments, size)), shared)

    def add(self, segment: int, products: Floats, columns: Sequence[int]) -> None:
        """Add W W^T, shape (1 + k, 1 + k), of a segment's measurements W: residuals, and derivatives by `columns`."""
        at = np.array(columns, dtype=np.intp)
        self.normal[segment][np.ix_(at, at)] += products[1:, 1:]
        self.right[segment][at] += products[1:, 0]
        self.cost += 0.5 * float(products[0, 0])

    def step(self, damping: float) -> tuple[Floats, Floats]:
        """Return the Levenberg-Marquardt step: of shared unknowns (shared,), and of own ones (segments, own)."""
        n = self.shared
        diagonal = np.einsum("sii->si", self.normal)
        shared_scale, own_scale = diagonal[:, :n].sum(axis=0), diagonal[:, n:]
        damped_own = self.normal[:, n:, n:] + damping * _diagonal(own_scale)
        inverse = np.linalg.pinv(damped_own, hermitian=True)
        mixed = self.normal[:, :n, n:]
        gain = mixed @ inverse
        reduced = np.sum(self.normal[:, :n, :n] - gain @ mixed.transpose(0, 2, 1), axis=0)
        right = np.sum(self.right[:, :n] - np.einsum("sij,sj->si", gain, self.right[:, n:]), axis=0)
        shared = -_solve(reduced + damping * np.diag(shared_scale), right)
        own_right = self.right[:, n:] + np.einsum("sji,j->si", mixed, shared)
        return shared, -np.einsum("sij,sj->si", inverse, own_right)

    def covariance(self) -> Floats:
        """Return the covariance of the shared unknowns, (shared, shared); infinite for undetermined ones."""
        n = self.shared
        mixed = self.normal[:, :n, n:]
        gain = mixed @ np.linalg.pinv(self.normal[:, n:, n:], hermitian=True)
        information = np.sum(self.normal[:, :n, :n] - gain @ mixed.transpose(0, 2, 1), axis=0)
        scale = np.sqrt(np.maximum(np.diag(information), 0.0))
        silent = scale == 0.0
        scale = np.where(silent, 1.0, scale)
        covariance = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
        covariance[silent, silent] = np.inf
        return np.asarray(covariance)


def _diagonal(values: Floats) -> Floats:
    return np.asarray(values[..., np.newaxis] * np.eye(values.shape[-1]))


def _solve(normal: Floats, right: Floats) -> Floats:
    """Solve with every unknown scaled; undetermined ones keep their values."""
    scale = np.sqrt(np.maximum(np.diag(normal), 0.0))
    scale = np.where(scale == 0.0, 1.0, scale)
    return np.asarray(np.linalg.pinv(normal / np.outer(scale, scale), hermitian=True) @ (right / scale) / scale)
