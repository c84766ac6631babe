"""Make a name for a new law from its place and formula."""

import re
from dataclasses import replace
from itertools import count

from cmr.estimation.laws.candidates import Candidate
from cmr.model.catalogue import LAWS
from cmr.model.laws.law import LONGEST_NAME, PREFIX, Law

FOR_A_NUMBER = 4  # characters reserved for a number after the name
PLAIN = {"**": " to ", "*": " ", "/": " per ", "+": " plus ", "-": " minus "}


def law_of(candidate: Candidate) -> Law:
    """Return a candidate as a law, named after its place and its first formula."""
    words = candidate.formulas[0]
    for sign, word in PLAIN.items():
        words = words.replace(sign, word)
    side = candidate.side if candidate.side not in ("", "both") else ""
    parts = re.findall(r"[a-z0-9]+", f"{candidate.place} {side} {words}")
    name = PREFIX + "_".join(parts)
    while len(name) > LONGEST_NAME - FOR_A_NUMBER:
        name = name.rpartition("_")[0]
    law = Law(
        name=name,
        place=candidate.place,
        side=candidate.side,
        formulas=candidate.formulas,
        constants=dict(candidate.constants),
    )
    return _with_free_name(law)


def _with_free_name(law: Law) -> Law:
    """Append a number to a law's name if another law of this process has the name."""
    first = law.name
    for number in count(2):
        if law.name not in LAWS or LAWS[law.name].is_same(law):
            break
        law = replace(law, name=f"{first}_{number}")
    return law
