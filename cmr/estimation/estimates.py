"""What an estimate is: a value with its standard deviation; and the error where there can be none."""

from dataclasses import dataclass

INTERVAL = 1.96  # standard deviations to either side that hold the truth in 95 % of cases


class EstimationError(Exception):
    """Nothing can be estimated from these data. The text says why and what to do."""


@dataclass(frozen=True)
class Estimate:
    """A parameter's estimated value and standard deviation, in the parameter's unit."""

    value: float
    std: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval."""
        return self.value - INTERVAL * self.std, self.value + INTERVAL * self.std
