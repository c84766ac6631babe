"""What settings of the emulated robot must fulfil."""

import math

from cmr.plant.parameters import RANGES


class SettingsError(ValueError):
    """The settings cannot be used; the text names the key and says what it should be."""


def require(holds: bool, section: object, name: str, expected: str) -> None:
    """Raise SettingsError, naming the section's key, unless what is expected of it holds."""
    if not holds:
        raise SettingsError(f"{type(section).__name__.lower()}: {name} must be {expected}.")


def require_possible(parameter: str, value: float, name: str) -> None:
    """Raise SettingsError unless the plant can have this value of a parameter."""
    least, largest = RANGES[parameter]
    if not least <= value <= largest:
        limit = f"{least:g} to {largest:g}" if math.isfinite(largest) else f"{least:g} or more"
        raise SettingsError(f"{name} must be {limit}, not {value:g}.")


def require_positive(section: object, *names: str) -> None:
    """Raise SettingsError unless these keys of a section are greater than 0."""
    for name in names:
        require(getattr(section, name) > 0, section, name, "greater than 0")
