"""Named manoeuvres: open-loop motor duties over time that reveal one physical effect or another.

`pieces` are what manoeuvres are made of, `drives` defines the duties of each, `table` its purpose and the space it
needs. They depend only on the model. The behaviour `manoeuvre` of `cmr.world.behaviours` drives them, and
`cmr.diagnosis.next_experiment` recommends them.
"""

from cmr.geometry.manoeuvres.manoeuvre import TYPICAL, Manoeuvre
from cmr.geometry.manoeuvres.pieces import Duties
from cmr.geometry.manoeuvres.table import MANOEUVRES, UnknownManoeuvreError, help_text, in_sequence

__all__ = ["MANOEUVRES", "TYPICAL", "Duties", "Manoeuvre", "UnknownManoeuvreError", "help_text", "in_sequence"]
