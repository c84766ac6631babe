"""What signals and regressors of residuals are called in a sentence."""

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


def _in_words(name: str) -> str:
    return name.replace("_", " ")
