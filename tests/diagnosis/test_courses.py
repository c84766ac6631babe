"""A diagnosis by free runs says how well it knows what it found, what remains, and what it did not look for."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.document import document
from cmr.diagnosis.report import report_of
from cmr.diagnosis.summary import summary
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.noise import Noise as FoundNoise
from cmr.estimation.simulation_error import covariance_by_blocks
from cmr.estimation.unexplained.remaining import COARSE_ENCODERS
from cmr.recordings.recording import Recording
from tests.reference_plant import REALISTIC, Noise, packets, recording
from tests.reference_plant.manoeuvres import RICH_DRIVE_SECONDS, rich_drive
from tests.support.faulty_drive import without
from tests.support.html_page import Page

pytestmark = pytest.mark.slow

BLOCKS, LENGTH = 400, 25


@pytest.mark.parametrize(("lasts", "samples"), [(LENGTH, BLOCKS), (1, BLOCKS * LENGTH)], ids=["bursts", "white"])
def test_errors_that_come_in_bursts_count_once_a_burst(lasts: int, samples: int) -> None:
    """What a mean is known to is one over the root of how many errors there are that have causes of their own."""
    random = np.random.default_rng(5)
    rest = np.repeat(random.standard_normal(BLOCKS * LENGTH // lasts), lasts)
    fit = Fit({"k1": 0.0}, ("k1",), rest, np.ones((len(rest), 1)), FoundNoise({}))
    blocks = np.repeat(np.arange(BLOCKS, dtype=np.float64), LENGTH)[:, None]
    assert np.sqrt(covariance_by_blocks(fit, blocks)[0, 0]) == pytest.approx(samples**-0.5, rel=0.15)


def rolling(noise: Noise = REALISTIC, **hidden: float) -> Recording:
    """A recording of a rich drive without its commands: only how the wheels turned is known."""
    whole = recording(packets(rich_drive(), RICH_DRIVE_SECONDS), hidden, RICH_DRIVE_SECONDS, noise, 6)
    return without(whole, "commands")


@pytest.mark.further  # that nothing else is named: the test with coarse encoders, below
def test_nothing_remains_where_the_body_moves_as_its_wheels_say() -> None:
    found = diagnose(rolling())
    assert found.verdict == "no_effect"
    assert document(found)["unexplained"] == {
        "present": False,
        "signal": None,
        "regressors": [],
        "share_of_residual_variance": 0.0,
        "not_judged": None,
    }


@pytest.mark.further  # test_finds_hidden_laws.py extends the model
def test_what_moves_the_body_beside_its_wheels_is_seen_and_the_model_extended_by_it() -> None:
    found = diagnose(rolling(side_wind=0.03))
    assert found.verdict == "unexplained"
    assert found.unexplained.signal == "sideways"
    assert "heading" in found.unexplained.regressors
    generic = found.unexplained.generic
    assert generic is not None
    assert {name.rsplit("_", 1)[0] for name in generic.estimates} == {"generic_motion_aside_abs_v"}
    assert generic.gain.interval[0] > 1.0


def test_where_structure_was_not_looked_for_its_share_is_not_known_and_the_reason_is_told() -> None:
    found = diagnose(rolling(replace(REALISTIC, ticks_per_turn=48.0)))
    unexplained = document(found)["unexplained"]
    assert (unexplained["present"], unexplained["share_of_residual_variance"]) == (False, None)
    assert unexplained["not_judged"] == COARSE_ENCODERS
    assert "the paper's model is sufficient" not in found.sentence
    assert "Whether errors remain unexplained was not judged." in " ".join(summary(found).split())
    page = Page(report_of(found)).text
    assert f"Not judged. {COARSE_ENCODERS}" in page
    assert "predict no residual" not in page
