"""Check whether a drive determines the inner constants of a law, or whether other constants fit as well.

For example, a spot on the floor that a robot only touched is consistent with many centres and radii, which imply
different forces elsewhere.
"""

from collections.abc import Sequence

import numpy as np

from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.linearised import SIDES, Linearised, is_of_wheels
from cmr.estimation.laws.refining import Refined, around
from cmr.estimation.laws.scan import scan
from cmr.recordings.signal import Floats

SAME = 0.98  # share of a law's contribution that another law reproduces, from which both are equivalent
WIDTHS = (1.0, 0.5, 0.25, 0.12, 0.06, 0.03, 0.015)  # of the steps to other constants, as shares of the reach of each


def undetermined(fit: Refined, margin: float) -> bool:
    """Return whether other constants of a law explain as much as the fitted ones and imply something different.

    "As much" allows for a difference of `margin` in -2 log likelihood.
    """
    return any(
        _undetermined(fit, number, margin) for number, law in enumerate(fit.laws) if law.constants and not law.others
    )


def _undetermined(fit: Refined, number: int, margin: float) -> bool:
    law, rest = fit.laws[number], fit.rest_without(number)
    others = [one for width in WIDTHS for one in around(law, width)]
    gains = {id(one.candidate.constants): one.gain for one in scan(fit.model, rest, [law, *others])}
    least = gains.get(id(law.constants), np.inf) - margin
    near = [one for one in others if gains.get(id(one.constants), -np.inf) > least]
    said = _said(fit.model, law)
    return any(_shared(said, _said(fit.model, one)) < SAME for one in near)


def _said(model: Linearised, law: Candidate) -> Floats:
    """Return the values of a law along the drives, without its coefficient."""
    sides: Sequence[int] = [k for k in (0, 1) if SIDES[law.side][k]] if is_of_wheels(law.place) else [-1]
    with model.only_tried():
        segments = range(len(model.variables))
        return np.concatenate([model.course(k, side, law.factors, law.constants) for k in segments for side in sides])


def _shared(one: Floats, other: Floats) -> float:
    """Return the share of one signal that another explains."""
    return float(one @ other) ** 2 / max(float(one @ one) * float(other @ other), 1e-300)
