"""A diagnosis does no more work than it must: counted, not timed, so that a busy computer changes nothing."""

from typing import Any

import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.model.extended.compose import LANES
from cmr.model.observer.drives import Drives
from cmr.model.observer.observer import Observer
from cmr.model.observer.structures import Innovations
from tests.hidden_effects import hidden_recording

pytestmark = pytest.mark.slow

SEED = 1000
# Blocks of LANES candidates that the observer drove through the log when this was written: 82 without any effect, 161
# with friction. Half as many again is a change for the worse.
MOST = {(): 123.0, ("coulomb_friction",): 241.0}


@pytest.mark.parametrize(
    "effects",
    [pytest.param((), marks=pytest.mark.further), ("coulomb_friction",)],
    ids=lambda effects: "-".join(effects) or "nothing",
)
def test_the_observer_drives_few_candidates_through_a_log(
    effects: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = hidden_recording(*effects, seed=SEED).recording
    observe, blocks = Observer.observe_all, list[float]()

    def counted(self: Observer, drives: Drives, **options: Any) -> Innovations:
        result = observe(self, drives, **options)
        candidates = result.wheel.shape[-1]
        blocks.append(-(-candidates // LANES) * drives.steps * drives.dt / recording.wheels.seconds[-1])
        return result

    monkeypatch.setattr(Observer, "observe_all", counted)
    diagnosis = diagnose(recording)
    assert tuple(effect.name for effect in diagnosis.effects) == effects
    assert 0.0 < sum(blocks) < MOST[effects]
