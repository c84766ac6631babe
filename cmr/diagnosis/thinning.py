"""Long drives say more than is needed: only so many of their readings are used that memory suffices."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cmr.diagnosis.experiment import Piece
from cmr.model.observer import RESTART

# Of half an hour at 100 Hz; some 60 candidates are tried at once, with a few numbers for each reading.
MOST_READINGS = 650_000


def share_used(pieces: Sequence[Piece]) -> int:
    """Return of how many readings one is to be used, so that not more than MOST_READINGS are."""
    heard = [piece.heard for piece in pieces]
    readings = sum(2 * len(one.wheel_time) + len(one.gyro_time) + 3 * len(one.pose_time) for one in heard)
    return max(1, -(-readings // MOST_READINGS))


def thinned(piece: Piece, every: int) -> Piece:
    """Return a piece with every so many-th reading of each sensor; where the path begins anew it still does."""
    if every == 1:
        return piece
    heard = piece.heard
    pose_use = heard.pose_use[::every].copy()
    begins = np.flatnonzero(heard.pose_use == RESTART)
    pose_use[np.minimum(-(-begins // every), len(pose_use) - 1)] = RESTART
    return replace(
        piece,
        heard=replace(
            heard,
            wheel_time=heard.wheel_time[::every].copy(),
            wheel=np.ascontiguousarray(heard.wheel[::every]),
            wheel_use=np.ascontiguousarray(heard.wheel_use[::every]),
            gyro_time=heard.gyro_time[::every].copy(),
            gyro=heard.gyro[::every].copy(),
            pose_time=heard.pose_time[::every].copy(),
            pose=np.ascontiguousarray(heard.pose[::every]),
            pose_use=pose_use,
        ),
        wheel_doubt=piece.wheel_doubt[::every],
    )
