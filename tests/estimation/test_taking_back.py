"""Names that are of no use in free runs on data left out are taken back."""

import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import NO_EFFECT
from cmr.estimation.search.trace import ADDED, REMOVED
from cmr.estimation.usefulness import OF_USE
from tests.hidden_effects import hidden_recording

pytestmark = pytest.mark.slow

LITTLE = 0.02  # by which the drift that chance made may move a parameter: what a calibration is to reach for k1
STRAYING_SPINS = 25  # a short drive on the spot in which chance looks like a battery that runs down


def test_what_is_of_no_use_in_free_runs_is_not_named_and_leaves_the_paper_s_model_in_the_intervals() -> None:
    found = diagnose(hidden_recording(manoeuvre="spins", seed=STRAYING_SPINS).recording)
    assert found.verdict == NO_EFFECT
    assert "battery_drift" in [candidate.name for candidate in found.candidates]
    # The search tells why: it was added, and taken back.
    told = [one for one in found.decisions if one.effects == ("battery_drift",)]
    assert [told[0].action, told[-1].action] == [ADDED, REMOVED]
    (measure,) = told[-1].measures
    assert (measure.quantity, measure.limit) == ("error_ratio", OF_USE)
    assert measure.value < OF_USE
    assert "battery_drift" in [candidate.name for candidate in found.harmless]
    assert found.baseline is not None
    assert found.extended is not None
    # What may be hidden beside the paper's model is averaged over, and does no harm.
    for name, before in found.baseline.estimates.items():
        assert found.extended.estimates[name].value == pytest.approx(before.value, rel=LITTLE), name
    assert found.gain is not None
    # Chance in the walk over what may be hidden moves a ratio by 0.015. Wheels err by 5 % more, yaw rates by 8 % less.
    assert min(found.gain.signals.values()) > 0.9
    assert found.gain.ratio > 0.98  # of the path
