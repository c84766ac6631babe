"""Manoeuvres by name: motor duties over time, open loop, that make one physical effect or another show.

`pieces` are what manoeuvres are made of, `drives` says how each is driven, `table` what it is good for and the space
it needs. They know nobody but the model. The behaviour `manoeuvre` of `cmr.world.behaviours` drives them, and
`cmr.diagnosis.next_experiment` recommends them.
"""

from cmr.geometry.manoeuvres.manoeuvre import TYPICAL, Manoeuvre
from cmr.geometry.manoeuvres.pieces import Duties
from cmr.geometry.manoeuvres.table import MANOEUVRES, UnknownManoeuvreError, help_text, in_sequence

__all__ = ["MANOEUVRES", "TYPICAL", "Duties", "Manoeuvre", "UnknownManoeuvreError", "help_text", "in_sequence"]
