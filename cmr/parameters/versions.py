"""Find the newest announced parameters of a robot, robust to wrong version numbers."""

from cmr.msg import parameters_t

MOST_EARLY = 16  # announcements from the future that are distinguished; their senders' clocks are wrong


class Versions:
    """Compares the versions of one robot's announcements.

    A version is the time [us] at which its content was written. A future version counts as written when first received,
    so that it does not block later ones, even if it is the last int64.
    """

    def __init__(self) -> None:
        self._newest = 0
        self._early: dict[tuple[str, int], int] = {}

    def is_outdated(self, message: parameters_t, now: int) -> bool:
        """Return whether a newer version was received before, which the sender does not know yet."""
        version = self.of(message, now)
        if version < self._newest:
            return True
        self._newest = version
        return False

    def of(self, message: parameters_t, now: int) -> int:
        """Return the version of an announcement received at `now` [us]."""
        if message.sequence <= now:
            return int(message.sequence)
        said = message.sha256, message.sequence
        first = self._early.pop(said, now)
        self._early[said] = first  # last in the order: repeated ones are kept
        if len(self._early) > MOST_EARLY:
            del self._early[next(iter(self._early))]
        return first
