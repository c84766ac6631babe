"""Report poorly determined parameters, effects that may be confused with them, and a useful second speed."""

from collections.abc import Mapping, Sequence

import numpy as np

from cmr.calibration.coverage import only_speed, second_speed
from cmr.estimation.averaging import Posterior
from cmr.estimation.commanded_speeds import in_words_of
from cmr.estimation.estimates import Estimate
from cmr.estimation.estimation import Estimation
from cmr.model.catalogue import CATALOGUE
from cmr.model.observer.observer import Observations
from cmr.recordings.signal import Floats

# Relative standard deviations above which a parameter is poorly determined: more than a drive at two speeds usually
# leaves.
WIDE: Mapping[str, float] = {
    "k2_over_k3": 0.015,
    "k1": 0.006,
    "response_time": 0.015,
    "speed_scale": 0.006,
    "base_width": 0.008,
}
# Above these, a second speed would improve a drive at one speed: a minute at two speeds leaves less (calibration.md).
WITH_TWO_SPEEDS: Mapping[str, float] = {
    "k2_over_k3": 0.006,
    "k1": 0.004,
    "response_time": 0.006,
    "speed_scale": 0.004,
    "base_width": 0.005,
}
STANDS_FOR: Mapping[str, str] = {"response_time": "k2_over_k3", "speed_scale": "k1"}  # in the model, by the file's name
POOR = 0.1  # relative standard deviation above which the kind of driving that would help is reported
TELLING: Mapping[str, str] = {
    "k2_over_k3": "Stops, starts and other changes of speed determine k2_over_k3.",
    "k1": "Steady driving at two speeds determines k1.",
    "response_time": "Stops, starts and other changes of speed determine response_time.",
    "speed_scale": "Steady driving determines speed_scale.",
    "base_width": "Turns in both directions determine base_width.",
}
HALF = 0.5  # of its standard deviation alone: below it, effects make a parameter much more certain
ALONE = "Three parameters alone do not describe this robot: it has the effects named here."
HIDING = 0.4  # correlation above which an undetected effect can hide in a parameter
UNSURE = (0.03, 0.97)  # probabilities between which the presence of an effect is open


def in_doubt(estimation: Estimation) -> tuple[str, ...]:
    """Return a sentence for each poorly determined parameter, and one on the drive that would help."""
    assert estimation.whole is not None
    average, reported = estimation.whole.average, in_words_of(estimation.estimates, estimation.controller)
    wide = _wide(reported)
    sentences = [_sentence(name, _share(reported[name]), average) for name in wide]
    return (*sentences, *_telling(wide, reported, one_speed(estimation)))


def in_doubt_alone(estimation: Estimation, alone: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Return the same sentences for the three parameters `alone`, or how certain effects would make them."""
    alone, beside = (in_words_of(those, estimation.controller) for those in (alone, estimation.estimates))
    wide = _wide(alone)
    sentences = [_sentence(name, _share(alone[name]), None) for name in wide]
    surer = [name for name in wide if name in beside and beside[name].std < HALF * alone[name].std]
    if surer and estimation.found.named:
        known = " and ".join(f"{name} to {100.0 * _share(beside[name]):.2g} %" for name in surer)
        return (*sentences, f"{ALONE} With them, without --paper-only, this drive determines {known}.")
    return (*sentences, *_telling(wide, alone, one_speed(estimation)))


def _wide(reported: Mapping[str, Estimate], limits: Mapping[str, float] = WIDE) -> list[str]:
    return [name for name in limits if name in reported and _share(reported[name]) > limits[name]]


def _share(estimate: Estimate) -> float:
    return estimate.std / abs(estimate.value)


def _telling(wide: Sequence[str], reported: Mapping[str, Estimate], speed: float | None) -> list[str]:
    """Return what further drive would help, especially after one at only one `speed` [m/s]; None: several speeds."""
    if speed is not None and (narrowed := _wide(reported, WITH_TWO_SPEEDS)):
        narrower = " and ".join(narrowed) if len(narrowed) < 3 else "all three"
        return [
            f"The whole drive is near {speed:.2g} m/s. Half a minute more at {second_speed(speed):.1g} m/s, in the "
            f"same drive or in another log, would narrow {narrower}."
        ]
    return [TELLING[name] for name in wide if _share(reported[name]) > POOR]


def _sentence(name: str, share: float, average: Posterior | None) -> str:
    known = f"{name} is known to {100.0 * share:.2g} % only"
    hiding = hiding_in(name, average) if average is not None else []
    if average is None or not hiding:
        return f"{known}."
    listed = ", ".join(f"{effect} (probability {average.presence[effect]:.2f})" for effect in hiding)
    return f"{known}: {listed} may be confused with it."


def hiding_in(name: str, average: Posterior) -> list[str]:
    """Return possible effects that correlate with the parameter, the most likely first."""
    stds = np.sqrt(np.maximum(np.diag(average.covariance), 1e-300))
    at = average.names.index(STANDS_FOR.get(name, name))
    hiding = []
    for effect, presence in average.presence.items():
        if UNSURE[0] < presence < UNSURE[1]:
            own = [average.names.index(parameter.name) for parameter in CATALOGUE[effect].parameters]
            if np.max(np.abs(average.covariance[at, own]) / (stds[at] * stds[own])) > HIDING:
                hiding.append(effect)
    return sorted(hiding, key=lambda effect: -average.presence[effect])


def one_speed(estimation: Estimation) -> float | None:
    """Return the speed [m/s] of a drive that has only one, else None."""
    speeds = np.concatenate([_speeds(p.segment.observations) for p in estimation.found.problem.predictors])
    speed = only_speed(speeds)
    return None if speed is None else speed * estimation.found.base.values["wheel_radius"]


def _speeds(observations: Observations) -> Floats:
    """Return the mean speed of both wheels [rad/s] between readings, (n,)."""
    turned = np.mean(np.diff(observations.wheel, axis=0), axis=1)
    return np.asarray(np.abs(turned) / np.diff(observations.wheel_time))
