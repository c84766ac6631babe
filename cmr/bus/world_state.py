"""WORLD_STATE as arrays: the bytes of the generated world_state_t, written and read at a fraction of its cost."""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from cmr.msg import world_state_t

HEAD = struct.Struct(">8sqi")  # the type's fingerprint, utime and n
FIELDS = ("robot_id", "origin", "x", "y", "theta", "psi_left", "psi_right", "domega_left", "domega_right")
BYTES_PER_ROBOT = 4 + 1 + 7 * 4


class WorldState(world_state_t):
    """A world_state_t whose fields may be arrays, and are arrays where it was decoded: of int64 and float64.

    `columns` are all fields that have an entry for each robot, in their order.
    """

    def __init__(self, utime: int, columns: Sequence[Any]) -> None:
        self.utime, self.n = utime, len(columns[0])
        for name, column in zip(FIELDS, columns, strict=True):
            setattr(self, name, column)

    def encode(self) -> bytes:
        """Return the bytes of the message."""
        n, columns = self.n, [getattr(self, name) for name in FIELDS[2:]]
        data = np.empty(HEAD.size + BYTES_PER_ROBOT * n, np.uint8)
        HEAD.pack_into(data.data, 0, world_state_t._get_packed_fingerprint(), self.utime, n)
        ids, origins, floats = _parts(data, n)
        ids[:], origins[:] = self.robot_id, self.origin
        np.concatenate(columns, out=floats, casting="same_kind")
        return data.tobytes()

    @staticmethod
    def decode(data: bytes) -> "WorldState":
        """Return the message in these bytes.

        Raises struct.error or ValueError where there are fewer bytes than the message says.
        """
        _, utime, n = HEAD.unpack_from(data)
        if not 0 <= n <= (len(data) - HEAD.size) // BYTES_PER_ROBOT:
            raise ValueError(f"{n} robots do not fit into {len(data)} bytes")
        ids, origins, floats = _parts(np.frombuffer(data, np.uint8), n)
        columns = floats.astype(np.float64).reshape(len(FIELDS) - 2, n)
        return WorldState(utime, (ids.astype(np.int64), origins.astype(np.int64), *columns))


def _parts(data: Any, n: int) -> tuple[Any, Any, Any]:
    """Return the ids, the origins and the seven columns one after another of n robots, as they lie in the bytes."""
    origins, floats, end = HEAD.size + 4 * n, HEAD.size + 5 * n, HEAD.size + BYTES_PER_ROBOT * n
    return data[HEAD.size : origins].view(">i4"), data[origins:floats].view("i1"), data[floats:end].view(">f4")
