"""Signatures under messages: right ones, none, and those of who has no key, changed the message, or repeats it."""

from collections.abc import Callable

from cmr.bus.messages import now_utime
from cmr.bus.signing import KEY_BYTES, TRAILER, Signer
from fuzzing.draws import Draws

WRONG_KEY = bytes(KEY_BYTES)
OFF = 2_000_000  # us; a signature of then is stale


class Signatures:
    """Signs by a key, or, without one, as processes do that have none."""

    def __init__(self, key: bytes | None, utime: Callable[[], int] = now_utime) -> None:
        self._right, self._none = Signer(key, utime), Signer(None, utime)
        self._wrong = Signer(WRONG_KEY, utime)
        self._late = Signer(key, lambda: utime() - OFF)
        self._last = b""

    def of(self, draws: Draws, channel: str, data: bytes) -> bytes:
        """Return a message as somebody sends it; six of ten are signed as they should be."""
        kind = draws.below(10)
        signers = {6: self._none, 7: self._wrong, 8: self._late}
        signed = signers.get(kind, self._right).sign(channel, data)
        if kind == 9:
            signed = draws.choice((data, self._last, self._damaged(draws, signed)))
        self._last = signed
        return signed

    def _damaged(self, draws: Draws, signed: bytes) -> bytes:
        at = max(len(signed) - 1 - draws.below(TRAILER.size), 0)
        return signed[:at] + draws.take(1) + signed[at + 1 :]
