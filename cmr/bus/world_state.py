"""WORLD_STATE as arrays: encodes and decodes world_state_t much faster than the generated class."""

import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.msg import world_state_t

HEAD = struct.Struct(">8sqi")  # the type's fingerprint, utime and n
FINGERPRINT = world_state_t._get_packed_fingerprint()
FLOATS_PER_ROBOT = 7  # x to domega_right
BYTES_PER_ROBOT = 4 + 1 + 4 * FLOATS_PER_ROBOT
Kind: TypeAlias = np.dtype[np.int32] | np.dtype[np.int8]
WholeNumbers: TypeAlias = Sequence[int] | NDArray[np.int64]
Numbers: TypeAlias = Sequence[float] | NDArray[np.float64]
ID, ORIGIN, FLOAT = np.dtype(">i4"), np.dtype("i1"), np.dtype(">f4")
MOST_REMEMBERED = 100  # sets of ids or origins whose bytes are cached


class WorldState(world_state_t):
    """A world_state_t whose fields may be arrays; after decoding they are arrays of int64 and float64.

    `state` holds all other per-robot fields, from x to domega_right.
    """

    def __init__(self, utime: int, robot_id: WholeNumbers, origin: WholeNumbers, *state: Numbers) -> None:
        self.utime, self.n = utime, len(robot_id)
        self.robot_id, self.origin = robot_id, origin
        self.x, self.y, self.theta, *wheels = state
        self.psi_left, self.psi_right, self.domega_left, self.domega_right = wheels

    def encode(self) -> bytes:
        """Return the bytes of the message."""
        head = HEAD.pack(FINGERPRINT, self.utime, self.n)
        pose, speeds = (self.x, self.y, self.theta), (self.psi_left, self.psi_right)
        floats = np.empty(FLOATS_PER_ROBOT * self.n, FLOAT)
        columns = (*pose, *speeds, self.domega_left, self.domega_right)
        np.concatenate(columns, out=floats, casting="same_kind")
        return b"".join((head, _bytes_of(self.robot_id, ID), _bytes_of(self.origin, ORIGIN), floats.data))

    @staticmethod
    def decode(data: bytes) -> "WorldState":
        """Return the message in these bytes.

        Raises struct.error or ValueError where there are fewer bytes than the message says.
        """
        _, utime, n = HEAD.unpack_from(data)
        if not 0 <= n <= (len(data) - HEAD.size) // BYTES_PER_ROBOT:
            raise ValueError(f"{n} robots do not fit into {len(data)} bytes")
        origins, floats = HEAD.size + 4 * n, HEAD.size + 5 * n
        ids = np.ndarray(n, ID, data, HEAD.size).astype(np.int64)
        kinds = np.ndarray(n, ORIGIN, data, origins).astype(np.int64)
        with np.errstate(invalid="ignore"):  # NumPy warns about some NaN bit patterns, which any sender may produce
            columns = np.ndarray((FLOATS_PER_ROBOT, n), FLOAT, data, floats).astype(np.float64)
        return WorldState(utime, ids, kinds, *columns)


def _bytes_of(numbers: WholeNumbers, kind: Kind) -> bytes:
    """Return ids or origins encoded; a tuple, which repeats at every step, is converted only once."""
    return _bytes_of_tuple(numbers, kind) if isinstance(numbers, tuple) else np.asarray(numbers).astype(kind).tobytes()


@lru_cache(MOST_REMEMBERED)
def _bytes_of_tuple(numbers: tuple[int, ...], kind: Kind) -> bytes:
    return np.array(numbers, kind).tobytes()
