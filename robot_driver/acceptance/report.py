"""The findings of the protocol, as a report for programs (JSON) and for a terminal."""

import json
import math
from dataclasses import asdict, dataclass, field

from robot_driver.acceptance.findings import FAILED, NOT_TRIED, PASSED, PROMISES, Finding, failed, verdict

SCHEMA = 1


@dataclass(frozen=True)
class Report:
    """The tested hardware and the findings. `short`: the short form, which shows less."""

    device: str
    controller: str
    gyro: str
    port: str
    host: str
    kernel: str
    python: str
    cmr: str
    utime: int
    seconds: float
    short: bool
    duty: float
    figures: dict[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    @property
    def verdicts(self) -> dict[int, str]:
        """Whether each tested promise passed, failed or was not tried."""
        looked_at = {finding.promise for finding in self.findings}
        return {number: verdict(number, self.findings) for number in PROMISES if number in looked_at}

    @property
    def failed(self) -> list[int]:
        """The promises that did not hold."""
        return failed(self.findings)

    @property
    def summary(self) -> str:
        """Return the result in a sentence."""
        verdicts = list(self.verdicts.values())
        counts = ", ".join(f"{verdicts.count(word)} {word}" for word in (PASSED, FAILED, NOT_TRIED))
        named = f"; failed: {', '.join(map(str, self.failed))}" if self.failed else ""
        return f"{len(verdicts)} promises: {counts}{named}."

    def to_json(self) -> str:
        """Return the report for programs; numbers that are not finite are null."""
        document = {"schema": SCHEMA, **asdict(self)}
        document["findings"] = [{**asdict(one), "verdict": one.verdict} for one in self.findings]
        document["promises"] = [
            {"number": number, "promise": PROMISES[number], "verdict": word} for number, word in self.verdicts.items()
        ]
        return json.dumps(_finite(document), indent=2) + "\n"

    def lines(self) -> list[str]:
        """Return the report for a terminal."""
        lines = [f"{self.device} at {self.port}, {self.host}, {self.kernel}", ""]
        for number, word in self.verdicts.items():
            lines.append(f"{word:9}  {number:2}  {PROMISES[number]}")
            for one in self.findings:
                if one.promise == number and (one.passed is not True or word == PASSED):
                    lines.append(f"{'':15}{one.verdict}: {_named(one)}{one.said}")
        return [*lines, "", self.summary]


def _named(one: Finding) -> str:
    return f"{one.check}: " if one.check else ""


def _finite(value: object) -> object:
    """Return a value with None in place of every number that is not finite."""
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
