"""Windowed recordings of unknown robots: what is hidden is named, and latencies are what they are."""

import pytest

from cmr.diagnosis.diagnose import diagnose
from tests.hidden_effects import hidden_recording
from tests.hidden_effects.cases import CONTROLLED_WINDOWS, WINDOWS
from tests.hidden_effects.judging import DEVIATIONS
from tests.support.lanes import further

pytestmark = pytest.mark.slow

OF_ONE_FRAME = {"slope", "surface_patch", "pose_distortion"}


@pytest.mark.parametrize(
    ("effects", "manoeuvre", "seed"),
    [
        (("pose_latency",), WINDOWS, 0),  # 34 ms late, which matters in fast turns; a tracker that jumps
        *further(
            (("pose_offset", "pose_latency"), WINDOWS, 1),  # pieces without poses behind a jump of the tracker
            (("gyro_latency", "pose_latency"), WINDOWS, 31),  # as if wheels slipped, and poses were a little less late
            (("pose_offset", "pose_latency"), CONTROLLED_WINDOWS, 1),  # speeds of the moment beside counts, 50 Hz
            (("pose_latency",), CONTROLLED_WINDOWS, 10),  # poses that are 0.4 s late
        ),
    ],
)
def test_what_is_hidden_in_windows_is_named_and_nothing_else(
    effects: tuple[str, ...], manoeuvre: str, seed: int
) -> None:
    hidden = hidden_recording(*effects, manoeuvre=manoeuvre, seed=seed)
    found = diagnose([hidden.recording])
    assert {one.name for one in found.effects} == set(effects)
    assert not {one.name for one in found.candidates} & OF_ONE_FRAME
    latency = next(one for one in found.effects if one.name == "pose_latency").estimates["pose_latency"]
    truth = hidden.truth.parameters["pose_latency"]
    assert latency.value == pytest.approx(truth, abs=DEVIATIONS * latency.std)
