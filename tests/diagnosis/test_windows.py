"""Windowed recordings with readings between the steps of the model: late sensors are distinguished from slip."""

import pytest

from cmr.diagnosis.diagnose import diagnose
from tests.hidden_effects import hidden_recording
from tests.hidden_effects.cases import CONTROLLED_WINDOWS, WINDOWS
from tests.support.lanes import further

pytestmark = pytest.mark.slow

LATE = ("gyro_latency", "pose_latency")


@pytest.mark.parametrize(("manoeuvre", "seed"), further((CONTROLLED_WINDOWS, 62), (WINDOWS, 43)))
def test_a_late_gyro_beside_late_poses_is_not_slip(manoeuvre: str, seed: int) -> None:
    hidden = hidden_recording(*LATE, manoeuvre=manoeuvre, seed=seed)
    named = {effect.name: effect for effect in diagnose(hidden.recording).effects}
    assert "longitudinal_slip" not in named
    for name in LATE:
        estimate = named[name].estimates[name]
        assert abs(estimate.value - hidden.truth.parameters[name]) < 3.0 * estimate.std


@pytest.mark.further  # ten seconds; test_windowed_recordings.py diagnoses others
def test_slip_that_a_late_gyro_explains_as_well_is_named_together_with_it() -> None:
    """To first order a late gyro explains a little less; only a fit shows that it explains the same."""
    hidden = hidden_recording(*LATE, manoeuvre=CONTROLLED_WINDOWS, seed=51)
    named = {effect.name: effect for effect in diagnose(hidden.recording).effects}
    slip = named.get("longitudinal_slip")
    assert "gyro_latency" in (named if slip is None else slip.indistinguishable_from)
