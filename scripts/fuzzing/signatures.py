"""Sign messages for fuzzing: validly, not at all, with a wrong key, too late, damaged, or with an old signature."""

from collections.abc import Callable

from cmr.bus.messages import now_utime
from cmr.bus.signing import KEY_BYTES, TRAILER, Signer
from fuzzing.draws import Draws

WRONG_KEY = bytes(KEY_BYTES)
STALE_BY_US = 2_000_000  # age of a signature that is too old


class Signatures:
    """Signs with a key; without one, messages stay as processes without a key send them."""

    def __init__(self, key: bytes | None, utime: Callable[[], int] = now_utime) -> None:
        self._right, self._none = Signer(key, utime), Signer(None, utime)
        self._wrong = Signer(WRONG_KEY, utime)
        self._late = Signer(key, lambda: utime() - STALE_BY_US)
        self._last = b""

    def of(self, draws: Draws, channel: str, data: bytes) -> bytes:
        """Return a message with a signature; six of ten signatures are valid."""
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
