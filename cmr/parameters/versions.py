"""Which of the announced parameters of a robot are the newest, whatever version they say they are."""

from cmr.msg import parameters_t

MOST_EARLY = 16  # announcements from the future that are distinguished; their senders' clocks are ahead, or they lie


class Versions:
    """Tells the versions of one robot's announcements apart.

    A version is the time [us] at which its content was written. One that is still to come counts as written when it was
    first heard, so that it does not shut out what follows it, be it of the last moment that an int64 holds.
    """

    def __init__(self) -> None:
        self._newest = 0
        self._early: dict[tuple[str, int], int] = {}

    def is_outdated(self, message: parameters_t, now: int) -> bool:
        """Return whether a newer version was asked about before: a sender that names this one has not heard of it."""
        version = self.of(message, now)
        if version < self._newest:
            return True
        self._newest = version
        return False

    def of(self, message: parameters_t, now: int) -> int:
        """Return the version of an announcement that was heard at `now` [us]."""
        if message.sequence <= now:
            return int(message.sequence)
        said = message.sha256, message.sequence
        first = self._early.pop(said, now)
        self._early[said] = first  # last in the order: what is repeated is kept
        if len(self._early) > MOST_EARLY:
            del self._early[next(iter(self._early))]
        return first
