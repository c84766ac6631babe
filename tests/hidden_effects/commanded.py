"""Commands of a manoeuvre that CMR itself has. The plant gets them as any others; there is no physics in them."""

from collections.abc import Mapping

from cmr.geometry.manoeuvres import in_sequence
from cmr.parameters.file import ParameterFile, Value
from tests.reference_plant import Commands, packets


def commands_of_sequence(name: str, nominal: Mapping[str, float], seconds: float) -> Commands:
    """Return the duties of a manoeuvre of short movements, such as short_drive, by these nominal parameters."""
    known = ParameterFile(0, {one: Value(value) for one, value in nominal.items()})
    return packets(in_sequence(name).duties(known.robot_parameters).at, seconds)
