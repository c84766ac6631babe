"""Report the gain of a formula as unexplained structure, if no formula is right."""

import numpy as np

from cmr.estimation.laws.linearised import seen_in
from cmr.estimation.laws.misfit import variables_of_law
from cmr.estimation.laws.refining import Refined
from cmr.estimation.prediction import SIGNALS
from cmr.estimation.problem import LARGE
from cmr.estimation.unexplained.result import Unexplained

# The regressors, as named in reports, of the variables of formulas.
REGRESSORS = {
    **{"v": "speed", "w": "yaw_rate", "dv": "acceleration", "dw": "yaw_acceleration", "theta": "heading", "t": "time"},
    **{"psi": "wheel_speed", "s": "wheel_speed", "other_psi": "wheel_speed", "charge": "energy"},
    **{"domega": "wheel_acceleration", "other_domega": "wheel_acceleration", "u": "command", "other_u": "command"},
    **{"since_turn": "time_since_the_turn_reversed", "way_since_turn": "distance_since_the_turn_reversed"},
}


def structure_of(fit: Refined) -> Unexplained:
    """Return the structure that the last law of a fit explains: the main signal, and its regressors.

    The gain of other parameters of the model is not counted.
    """
    law = fit.laws[-1]
    columns = fit.columns * fit.mask[:, None]
    first = columns.shape[1] - len(fit.coefficients[-1])
    others = np.linalg.qr(columns[:, :first])[0]
    own = columns[:, first:] @ np.array(fit.coefficients[-1])
    own -= others @ (others.T @ own)
    after, before = (np.clip(white, -LARGE, LARGE) ** 2 for white in (fit.white, fit.white - own))
    drops, shares = {}, {}
    for name in seen_in(law.place):
        rows = fit.mask & (fit.rest.signal == SIGNALS.index(name))
        drops[name] = float(np.sum(before[rows]) - np.sum(after[rows]))
        shares[name] = drops[name] / max(float(np.sum(before[rows])), 1e-12)
    signal = max(drops, key=lambda name: drops[name])
    regressors = tuple(dict.fromkeys(REGRESSORS.get(name, name) for name in variables_of_law(law))) or ("time",)
    return Unexplained(present=True, signal=signal, regressors=regressors, share=max(shares[signal], 0.0))
