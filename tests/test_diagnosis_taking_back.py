"""Names with which free runs stray farther on data left out are taken back; without names the model is the paper's."""

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import NO_EFFECT
from tests.hidden_effects import hidden_recording

STRAYING_SPINS = 25  # a short drive on the spot in which chance looks like a battery that runs down


def test_what_free_runs_contradict_is_not_named_and_leaves_the_papers_model() -> None:
    found = diagnose(hidden_recording(manoeuvre="spins", seed=STRAYING_SPINS).recording)
    assert found.verdict == NO_EFFECT
    assert "battery_drift" in [candidate.name for candidate in found.candidates]
    assert found.baseline is not None
    assert found.extended is not None
    assert found.extended.estimates == found.baseline.estimates
    assert found.gain is not None
    assert set(found.gain.signals.values()) == {1.0}
