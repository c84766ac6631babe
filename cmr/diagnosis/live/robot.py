"""Monitor one robot, second by second."""

import math
from collections import deque

from cmr.diagnosis.live.causes import Cause
from cmr.diagnosis.live.changes import BY_NAME, Sizes
from cmr.diagnosis.live.detection import Detector, Residuals
from cmr.diagnosis.live.expectation import Expectation, Residual
from cmr.diagnosis.live.explaining import ROUGH, Explanation, Observed, explain
from cmr.diagnosis.live.faults import Faults
from cmr.diagnosis.live.measures import MEASURES, MOVING_SECONDS
from cmr.diagnosis.live.second import Second
from cmr.diagnosis.live.suspicion import Announcer, Suspicion

WINDOW = 20  # seconds explained together, at most
CONSIDERED = 2_000_000  # us after an alarm until it is explained, as the first seconds may fit many causes
CALM = 0.3  # of the threshold; new motion is learned only while no alarm is near
UNEXPLAINED_FOR = 20_000_000  # us after which an alarm without a cause is forgotten


class RobotWatch:
    """Monitors one robot with its parameters; pass seconds to `add`, which returns news."""

    def __init__(self) -> None:
        self.faults = Faults()
        self._expectations = {measure.name: Expectation(measure) for measure in MEASURES}
        self._detector = Detector()
        self._window: deque[Observed] = deque(maxlen=WINDOW)
        self._explanation = Explanation()
        self._unexplained: Suspicion | None = None
        self._forget_at = 0
        self._since: int | None = None
        self._decision = 0
        self._moving_seconds = 0
        self._announcer = Announcer()

    def add(self, second: Second) -> list[str]:
        """Process one more second; return the sentences to report."""
        self.faults.add(second)
        self._moving_seconds += second.moving
        residuals = self._residuals(second)
        beyond_present = self._beyond_present(second, residuals)
        if residuals:
            self._window.append(Observed(second, residuals, beyond_present))
        since = self._detector.add(second, beyond_present, self._explanation.sizes)
        if since is not None and self._since is None:
            self._since, self._decision = since, second.end + CONSIDERED
        if self._since is not None and second.end >= self._decision:
            self._explain(second.end, self._since)
        if second.end >= self._forget_at:
            self._unexplained = None
        return self._announcer.news(second.end, self.suspicions())

    def suspicions(self) -> dict[str, Suspicion]:
        """Return what is suspected, by key."""
        found = dict(self.faults.present)
        if self._unexplained is not None:
            found["unexplained"] = self._unexplained
        for cause, sizes in self._explanation.causes:
            found[cause.key] = self._suspicion(cause, sizes)
        return found

    @property
    def suspected(self) -> list[str]:
        """The current suspicions, in the sentences in which they were reported."""
        return list(self._announcer.present.values())

    def activity(self) -> str:
        """Return a sentence on the current activity while nothing is suspected."""
        if self._moving_seconds < MOVING_SECONDS:
            return f"learning how it moves: {self._moving_seconds} of {MOVING_SECONDS} s in motion."
        signals = ["wheels", *(name for name in ("gyro", "poses") if self.faults.hears(name))]
        return f"watching {', '.join(signals)}; it moves as at the start."

    def _residuals(self, second: Second) -> dict[str, Residual]:
        """Compare the second with the expectation; learn from it if necessary."""
        calm = not self._explanation.causes and self._since is None and self._detector.level < CALM
        residuals: dict[str, Residual] = {}
        for name, expectation in self._expectations.items():
            if name in self.faults.muted or math.isnan(expectation.measure.value(second)):
                continue
            residual = expectation.residual(second) if expectation.ready else None
            if residual is not None and not residual.novel:
                residuals[name] = residual
            elif calm and (residual is None or residual.likely):
                expectation.learn(second)
        return residuals

    def _beyond_present(self, second: Second, residuals: Residuals) -> Residuals:
        """Return the residuals minus the current explanation."""
        beyond = dict(residuals)
        for change, size in self._explanation.sizes.items():
            for name, shift in BY_NAME[change].shifts(second).items():
                if name in beyond:
                    value, noise, doubt = beyond[name]
                    beyond[name] = Residual(value - size * shift, noise, math.hypot(doubt, ROUGH * size * shift))
        return beyond

    def _explain(self, utime: int, since: int) -> None:
        """Find the cause of a change since then."""
        observed = [item for item in self._window if item.second.end >= since]
        found = explain(observed, self._explanation, self.faults.voltage)
        if found.complete or found.names == self._explanation.names:
            self._explanation, self._unexplained = found, None
        else:
            self._unexplained = unexplained(found)
            self._forget_at = utime + UNEXPLAINED_FOR
        self._since = None
        self._detector.reset()

    def _suspicion(self, cause: Cause, sizes: Sizes) -> Suspicion:
        sentence = cause.sentence(sizes, self.faults.voltage)
        others = " or ".join(rival.title(theirs) for rival, theirs in self._explanation.rivals)
        if others:
            sentence += f" It could also be: {others}."
        return Suspicion(cause.title(sizes), sentence, max(map(abs, sizes.values())))


def unexplained(found: Explanation) -> Suspicion:
    """Return the suspicion of a change that no cause explains well."""
    nearest = " and ".join(BY_NAME[name].clause(size) for name, size in found.sizes.items())
    return Suspicion(
        "the unexplained change",
        "Something has changed that no known cause explains. "
        f"The closest description is: {nearest or 'none'}. Keep the log and run cmr-diagnose on it.",
    )
