"""Logs of robots with a hidden effect, and what was hidden: what a diagnosis is measured on.

    from tests.hidden_effects import hide

    log = hide("coulomb_friction", manoeuvre="rich", seed=3, path="run.lcm")

`log.path` is an LCM event log of 120 s that holds nothing of the truth, `log.truth` tells what is hidden in it. All of
it follows from the arguments (those of Case): the same case gives the same log. The robot is that of
tests/reference_plant, which shares no code with the model. `sets` are the cases by which a diagnosis is measured,
`scoring` how.
"""

from tests.hidden_effects.cases import Case, Truth
from tests.hidden_effects.hiding import HiddenLog, HiddenRecording, hidden_recording, hide

__all__ = ["Case", "HiddenLog", "HiddenRecording", "Truth", "hidden_recording", "hide"]
