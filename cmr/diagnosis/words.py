"""What signals and regressors of residuals are called in a sentence, and what is left of them."""

import math

from cmr.estimation.unexplained.result import Unexplained

FEW = 0.1  # a share below which tenths of a percent are told
SIGNALS = {
    "psi_left": "left wheel speed",
    "psi_right": "right wheel speed",
    "yaw_rate": "yaw rate",
    "forward": "forward position",
    "sideways": "sideways position",
    "heading": "heading",
}
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
    "x": "place in x",
    "y": "place in y",
    "heading": "heading",
    "wheel_angle_left": "left wheel angle",
    "wheel_angle_right": "right wheel angle",
    "energy": "energy spent",
}


def signal_name(name: str) -> str:
    """Return what a signal is called; its own name in words where it is not known."""
    return SIGNALS.get(name, _in_words(name))


def regressor_name(name: str) -> str:
    """Return what a regressor is called; its own name in words where it is not known."""
    return REGRESSORS.get(name, _in_words(name))


def share_sentence(unexplained: Unexplained, signal: str, regressors: str) -> str:
    """Return what the share of the errors that nothing explains is of, and what speaks for it, without a full stop.

    `signal` and `regressors` are theirs in words.
    """
    digits = 0 if unexplained.share >= FEW else 1
    share = f"{100.0 * unexplained.share:.{digits}f} %" if math.isfinite(unexplained.share) else "a part"
    if unexplained.bursts:
        return (
            f"{unexplained.bursts} short bursts make {share} of the squared one-step prediction errors of the {signal}"
        )
    of = f"{share} of the variance of the one-step prediction errors of the {signal}"
    return f"{of} is foretold by {regressors}, on data that this was not fitted on"


def _in_words(name: str) -> str:
    return name.replace("_", " ")
