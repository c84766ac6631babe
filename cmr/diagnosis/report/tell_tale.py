"""Choose the plot that shows an effect: the residual over the regressor where most structure is gone with it."""

from collections.abc import Iterable

from cmr.diagnosis.report.pairs import Pair

FAINTEST = 0.01  # share of the mean square of a residual; less structure than that nobody sees
TRUST = 3  # power to which words count: they know where an effect shows that makes structure over much else
WHEELS = ("psi_left", "psi_right")
COMMANDS = ("command_left", "command_right")
# What words in `Effect.shows_in` say about the signal, and about the regressor.
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
    """Return the pair that shows an effect best; None where no pair shows it.

    That is where the most structure is gone, counted many times where `shows_in`, the catalogue's words on where the
    effect shows, speak of this signal and of this regressor.
    """
    shown = [pair for pair in pairs if pair.removed > FAINTEST]
    return max(shown, key=lambda pair: pair.removed * fit(pair.signal, pair.regressor, shows_in), default=None)


def fit(signal: str, regressor: str, shows_in: str) -> float:
    """Return how many times a pair counts: once, and more for each of the words that speak of it."""
    of_signal, of_regressor = (
        _spoken_of(name, words, shows_in) for name, words in ((signal, SIGNAL_WORDS), (regressor, REGRESSOR_WORDS))
    )
    return float(((1 + of_signal) * (1 + of_regressor)) ** TRUST)


def _spoken_of(name: str, words: dict[str, tuple[str, ...]], text: str) -> int:
    return sum(name in names for phrase, names in words.items() if phrase in text)
