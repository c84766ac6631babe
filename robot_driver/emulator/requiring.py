"""Requirements on the settings of the emulated robot."""

import math

from cmr.documents.document import DocumentError
from cmr.plant.parameters import RANGES


class SettingsError(DocumentError, ValueError):
    """The settings cannot be used; the text names file, line and key, and says what it should be."""

    after = " "
    unknown = "is unknown. Known are: {known}."
    section = "section"
    not_yaml = "cannot be read: it is not YAML"


def require(holds: bool, expected: str, *keys: str) -> None:
    """Raise SettingsError, naming the section's key, unless the requirement holds."""
    if not holds:
        raise SettingsError(f"must be {expected}.", *keys)


def require_possible(parameter: str, value: float, *keys: str) -> None:
    """Raise SettingsError unless the value is within the plant's range for a parameter."""
    least, largest = RANGES[parameter]
    if not least <= value <= largest:
        limit = f"{least:g} to {largest:g}" if math.isfinite(largest) else f"{least:g} or more"
        raise SettingsError(f"must be {limit}, not {value:g}.", *keys)


def require_positive(section: object, *names: str) -> None:
    """Raise SettingsError unless these keys of a section are greater than 0."""
    for name in names:
        require(getattr(section, name) > 0, "greater than 0", name)
