"""Planners that are never ready, or late."""

from cmr.investigation.driving import AtOnce, Deciding
from cmr.investigation.engine import Decision
from cmr.investigation.movements import PERIOD


class Never:
    """A planner that is never ready."""

    seconds = 0.0

    def begin(self, deciding: object) -> None:
        """Do not decide."""

    def result(self) -> tuple[bool, None]:
        """Return that nothing is there."""
        return False, None

    def end(self) -> None:
        """Do nothing."""


class Slow(AtOnce):
    """A planner that needs so many turns of the drive for each decision."""

    def __init__(self, turns: int) -> None:
        super().__init__()
        self.seconds = turns * PERIOD
        self._turns, self._left = turns, 0

    def begin(self, deciding: Deciding) -> None:
        """Begin to decide."""
        super().begin(deciding)
        self._left = self._turns

    def result(self) -> tuple[bool, Decision | None]:
        """Return the decision once it was asked for often enough."""
        self._left -= 1
        return super().result() if self._left < 0 else (False, None)
