"""Estimate the clock of a robot, from the stamps of its messages and their times of arrival."""

from cmr.bus.clock_map import ClockMap

SECONDS = 1e-6  # in a microsecond
# s; a smaller offset cannot be distinguished from the messages' delay, and is not corrected.
NOTICED = 0.02


class RobotClock:
    """Converts stamps of a robot's clock to this computer's; times in us.

    Stamps that agree with this computer's clock are not changed. `offset` is how far [s] the robot's clock is behind.
    """

    def __init__(self) -> None:
        self.offset = 0.0
        self._map = ClockMap()
        self._epoch: int | None = None  # us; origin of times, so that doubles are exact
        self._unstamped = 0

    def here(self, stamp: int, arrival: int) -> int | None:
        """Return the local time of a stamp that arrived now; None while the robot's clock is not known."""
        if stamp <= 0:
            self._unstamped += 1
            return arrival
        self._epoch = arrival if self._epoch is None else self._epoch
        sent, arrived = (stamp - self._epoch) * SECONDS, (arrival - self._epoch) * SECONDS
        self._map.add(sent, arrived)
        if not self._map.is_known:
            return None
        here = self._map.here(sent)
        self.offset = here - sent
        return stamp if abs(self.offset) < NOTICED else self._epoch + round(here / SECONDS)

    def remark(self) -> str:
        """Return, in sentences, the difference of the clocks; empty if they agree."""
        sentences = []
        if abs(self.offset) >= NOTICED:
            direction = "behind" if self.offset > 0.0 else "ahead of"
            sentences.append(
                f"The robot's clock is {abs(self.offset):.3f} s {direction} this computer's; its time stamps are "
                "corrected by that."
            )
        if self._map.restarts:
            sentences.append(f"The robot's clock was set {self._map.restarts} times.")
        if self._unstamped:
            sentences.append(f"Messages without a time stamp, taken by their arrival: {self._unstamped}.")
        return " ".join(sentences)
