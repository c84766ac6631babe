"""The driver's promises, and the findings about each."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

PROMISES = {
    1: "Replies in pieces lose and corrupt nothing.",
    2: "Lost replies do not disturb the rhythm, at 50 Hz.",
    3: "Damage is never published, nor a late reply as another's.",
    4: "The reply deadline follows from the baud rate.",
    5: "A silent device never ends the process; motion of its wheels meanwhile is counted.",
    6: "The host's death stops the motors; so does a device that hears, but no longer understands duties.",
    7: "The watchdog is set, read back, and read again while driving.",
    8: "A stale command becomes zero at once; nothing jumps when commands resume, or after a pause.",
    9: "A signal ends with zero acknowledged.",
    10: "Unplugging is reported within 0.5 s; the device comes back within a second, and from zero.",
    11: "A numbered port draws a warning.",
    12: "A second driver on the same port is refused, by a lock and by TIOCEXCL.",
    13: "Encoder counts wrap both ways; a reset is distinguished from a jump.",
    14: "Stamps strictly increase, and bursts are spread.",
    15: "An invalid rate is never reported as valid, also after gaps in which a gyro was off.",
    16: "A low battery is reported, an empty one stops the robot for good, an unknown one until it is known.",
    17: "Rate and round-trip time are reported on PROCESS_STATUS.",
    18: "A released ESTOP moves nothing before zero is commanded after the release; one engaged before is heard first.",
    19: "An engaged ESTOP outlives its sender and the driver, and ends by a release with name and reason alone.",
}
PASSED, FAILED, NOT_TRIED = "passed", "failed", "not tried"


@dataclass(frozen=True)
class Finding:
    """One check of a promise: its subject, whether it held (None: not tried), and figures.

    `said` is a sentence for a person, or why it was not tried. `values` are figures for programs, by name with unit.
    """

    promise: int
    check: str
    passed: bool | None
    said: str
    values: dict[str, float] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """The verdict in one word."""
        return NOT_TRIED if self.passed is None else PASSED if self.passed else FAILED


def verdict(promise: int, findings: Iterable[Finding]) -> str:
    """Return the combined verdict of all checks of a promise: one failure fails it; otherwise it needs at least one
    pass.
    """
    verdicts = {finding.verdict for finding in findings if finding.promise == promise}
    return next((one for one in (FAILED, PASSED) if one in verdicts), NOT_TRIED)


def failed(findings: Iterable[Finding]) -> list[int]:
    """Return the promises that did not hold."""
    return sorted({finding.promise for finding in findings if finding.passed is False})


def milliseconds(seconds: float) -> str:
    """Return a time for a person."""
    return f"{1e3 * seconds:.0f} ms" if math.isfinite(seconds) else "never"
