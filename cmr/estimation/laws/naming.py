"""The name of a law that nobody has named yet: its place and what its formula says, in words."""

import re

from cmr.estimation.laws.candidates import Candidate
from cmr.model.laws.law import LONGEST_NAME, PREFIX, Law

PLAIN = {"**": " to ", "*": " ", "/": " per ", "+": " plus ", "-": " minus "}


def law_of(candidate: Candidate) -> Law:
    """Return the law that a candidate is, called after its place and its first formula."""
    words = candidate.formulas[0]
    for sign, word in PLAIN.items():
        words = words.replace(sign, word)
    side = candidate.side if candidate.side not in ("", "both") else ""
    parts = re.findall(r"[a-z0-9]+", f"{candidate.place} {side} {words}")
    name = PREFIX + "_".join(parts)
    while len(name) > LONGEST_NAME:
        name = name.rpartition("_")[0]
    return Law(
        name=name,
        place=candidate.place,
        side=candidate.side,
        formulas=candidate.formulas,
        constants=dict(candidate.constants),
    )
