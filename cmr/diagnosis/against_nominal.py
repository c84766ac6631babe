"""Notes on how the fitted robot compares with the nominal one."""

import math
from collections.abc import Iterator, Mapping

from cmr.diagnosis.result import Diagnosis, Fitted
from cmr.estimation.gain import Gain
from cmr.model.catalogue import definition
from cmr.parameters.file import ParameterFile

FAR = 0.1  # share of a nominal dimension; a fit that differs by more is reported
MUCH_WORSE = 1.1  # times the nominal robot's error; less than that may be chance
USUAL_WIDTHS = (1.0, 2.5)  # of skid-steer robots, fitted over geometric
CHECK_RADIUS = (
    "Check the nominal value, the encoder's ticks per turn and the scale of the poses. Slipping wheels look alike."
)
CHECK_WIDTH = "Check the nominal value, the wheel radius, and that left and right are not swapped."
SKIDDING = (
    "A skid-steer robot's wheels slip sideways in turns, which counts as base width: one and a half to two times the "
    "geometric one is usual."
)


def notes_on_nominal(nominal: ParameterFile, found: Diagnosis) -> Iterator[str]:
    """Yield sentences on how the fitted models compare with the robot as it was given."""
    assert found.baseline is not None
    assert found.extended is not None
    given = {name: value.value for name, value in nominal.values.items()}
    yield from dimension_notes(given, found.baseline, found.extended)
    if found.nominal is not None and found.gain_over_nominal is not None:
        yield from worse_than_nominal(found.nominal, found.baseline, found.extended, found.gain_over_nominal)


def dimension_notes(given: Mapping[str, float], baseline: Fitted, extended: Fitted) -> Iterator[str]:
    """Yield a sentence for each of wheel_radius [m] and base_width [m] that is far from the `given` value."""
    for name in ("wheel_radius", "base_width"):
        for fitted, where in ((extended, ""), (baseline, " in the paper's model")):
            estimate = fitted.estimates.get(name)
            nominal = given.get(name, math.nan)
            if estimate is not None and abs(estimate.value / nominal - 1.0) > FAR:
                yield _far_off(name, estimate.value, nominal, where)
                break


def _far_off(name: str, value: float, nominal: float, where: str) -> str:
    percent, unit = 100.0 * (value / nominal - 1.0), definition(name).unit
    usual = USUAL_WIDTHS[0] < value / nominal < USUAL_WIDTHS[1]
    check = CHECK_RADIUS if name == "wheel_radius" else SKIDDING if usual else CHECK_WIDTH
    size = f"{abs(percent):.0f} % {'larger' if percent > 0.0 else 'smaller'}"
    return f"{name}{where} is {value:.4g} {unit}, {size} than the nominal {nominal:.4g} {unit}. {check}"


def worse_than_nominal(nominal: Fitted, baseline: Fitted, extended: Fitted, over_nominal: Gain) -> Iterator[str]:
    """Yield a sentence for each fitted model that predicts the path worse than the nominal parameters."""
    least = nominal.held_out_path_rmse
    if over_nominal.interval[1] < 1.0 and over_nominal.ratio < 1.0 / MUCH_WORSE:
        yield (
            "The fitted parameters predict the path of held-out data less accurately "
            f"({extended.held_out_path_rmse:.4f} m) than the nominal ones ({least:.4f} m): keep the nominal ones."
        )
    elif baseline.held_out_path_rmse > MUCH_WORSE * least:
        yield (
            f"The paper's model, fitted, predicts the path of held-out data less accurately "
            f"({baseline.held_out_path_rmse:.4f} m) than the nominal parameters ({least:.4f} m): what counts is the "
            "improvement over the nominal parameters."
        )
