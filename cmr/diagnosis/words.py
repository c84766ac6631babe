"""Names of signals and regressors in sentences, and shared sentences."""

import math
from collections.abc import Sequence

from cmr.diagnosis.result import Candidate
from cmr.estimation.search.measures import with_unit
from cmr.estimation.unexplained.result import Unexplained
from cmr.model.catalogue import definition

MOST_NAMED = 3  # effects in one sentence
FEW = 0.1  # shares below this are given to a tenth of a percent
SIGNALS = {
    "psi_left": "left wheel speed",
    "psi_right": "right wheel speed",
    "yaw_rate": "yaw rate",
    "forward": "forward position",
    "sideways": "sideways position",
    "heading": "heading",
}
GAINED = {"psi": "wheel speeds", "yaw_rate": "yaw rate"}  # signals of a gain beside the path
REGRESSORS = {
    "time": "time",
    "command_left": "left command",
    "command_right": "right command",
    "command_change": "change of command",
    "speed": "speed",
    "yaw_rate": "yaw rate",
    "speed_times_yaw_rate": "speed times yaw rate",
    "acceleration": "acceleration",
    "yaw_acceleration": "yaw acceleration",
    "x": "x position",
    "y": "y position",
    "heading": "heading",
    "wheel_angle_left": "left wheel angle",
    "wheel_angle_right": "right wheel angle",
    "energy": "energy used",
}


def signal_name(name: str) -> str:
    """Return what a signal is called; from its identifier if unknown."""
    return SIGNALS.get(name, _in_words(name))


def regressor_name(name: str) -> str:
    """Return what a regressor is called; from its identifier if unknown."""
    return REGRESSORS.get(name, _in_words(name))


def share_sentence(unexplained: Unexplained, signal: str, regressors: str) -> str:
    """Return a clause on the unexplained share of the errors, and what predicts it.

    `signal` and `regressors` are their names in words.
    """
    digits = 0 if unexplained.share >= FEW else 1
    share = f"{100.0 * unexplained.share:.{digits}f} %" if math.isfinite(unexplained.share) else "a part"
    if unexplained.bursts:
        of = f"of the squared one-step prediction errors of the {signal}"
        return f"{unexplained.bursts} short bursts contain {share} {of}"
    of = f"{share} of the variance of the one-step prediction errors of the {signal}"
    return f"{of} is predicted by {regressors}, on left-out data"


def harmless_sentence(candidates: Sequence[Candidate]) -> str:
    """Return a sentence on effects that are significant but too small to matter, with sizes; empty without any."""
    sizes = ", ".join(map(_size_of, candidates))
    return f"Seen, but too small to matter: {sizes}." if sizes else ""


def some_of(names: Sequence[str]) -> list[str]:
    """Return at most MOST_NAMED names, and the number of others."""
    more = len(names) - MOST_NAMED
    return [*names[:MOST_NAMED], *([f"{more} more (see diagnosis.json)"] if more > 0 else [])]


def _size_of(candidate: Candidate) -> str:
    """Return an effect with the values of its parameters, with units."""
    values = [(name, with_unit(one.value, definition(name).unit)) for name, one in candidate.estimates.items()]
    if len(values) == 1:
        return f"{candidate.name} {values[0][1]}"
    return f"{candidate.name} ({', '.join(f'{name} {value}' for name, value in values)})" if values else candidate.name


def _in_words(name: str) -> str:
    return name.replace("_", " ")
