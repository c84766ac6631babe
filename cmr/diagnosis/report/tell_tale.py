"""Choose the plot that shows an effect best: the pair from which it removes most structure."""

from collections.abc import Iterable

from cmr.diagnosis.report.pairs import Pair

FAINTEST = 0.01  # share of a residual's mean square; less structure is not visible
TRUST = 3  # exponent of the weight of words: they identify the right plot if an effect has structure in many
WHEELS = ("psi_left", "psi_right")
COMMANDS = ("command_left", "command_right")
# Words in `Effect.shows_in` that refer to signals and regressors.
SIGNAL_WORDS = {
    "wheel speed": WHEELS,
    "wheel acceleration": WHEELS,
    "encoders against": WHEELS,
    "yaw": ("yaw_rate", "heading"),
    "gyro": ("yaw_rate",),
    "the pose": ("forward", "sideways", "heading"),
    "pose and": ("forward", "heading"),
    "along the motion": ("forward",),
    "sideways": ("sideways",),
    "distances": ("forward",),
    "speed and yaw": ("forward", "yaw_rate"),
}
REGRESSOR_WORDS = {
    "heading": ("heading",),
    "place": ("x", "y"),
    "time": ("time",),
    "slowly": ("time",),
    "slow trend": ("time",),
    "at rest": ("time",),
    "effort": ("energy", "time"),
    "once per turn": ("wheel_angle_left", "wheel_angle_right"),
    "turns": ("yaw_rate",),
    "clockwise": ("yaw_rate",),
    "fast turns": ("speed_times_yaw_rate",),
    "along the motion": ("speed",),
    "distances": ("speed",),
    "to the speed": ("speed",),
    "high speed": ("speed", *COMMANDS),
    "change sign": (*COMMANDS, "speed"),
    "duty": COMMANDS,
    "load": COMMANDS,
    "the command": (*COMMANDS, "command_change"),
    "change of": ("command_change",),
    "changes of": ("command_change",),
    "steps": ("command_change",),
    "starts": ("command_change", *COMMANDS),
    "reversals": ("command_change",),
    "accelerations": ("acceleration", "yaw_acceleration"),
    "begin and end": ("yaw_acceleration",),
    "left against right": COMMANDS,
}


def tell_tale(pairs: Iterable[Pair], shows_in: str) -> Pair | None:
    """Return the pair that shows an effect best; None if none does.

    It has the most removed structure, weighted by matching words of `shows_in`, the catalogue's text on where the
    effect is visible.
    """
    shown = [pair for pair in pairs if pair.removed > FAINTEST]
    return max(shown, key=lambda pair: pair.removed * fit(pair.signal, pair.regressor, shows_in), default=None)


def fit(signal: str, regressor: str, shows_in: str) -> float:
    """Return the weight of a pair: 1, and more for each matching word."""
    of_signal, of_regressor = (
        _spoken_of(name, words, shows_in) for name, words in ((signal, SIGNAL_WORDS), (regressor, REGRESSOR_WORDS))
    )
    return float(((1 + of_signal) * (1 + of_regressor)) ** TRUST)


def _spoken_of(name: str, words: dict[str, tuple[str, ...]], text: str) -> int:
    return sum(name in names for phrase, names in words.items() if phrase in text)
