"""The diagnosis by courses says how well it knows what it found, and what it did not look for."""

import numpy as np
import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.document import document
from cmr.diagnosis.report import report_of
from cmr.diagnosis.summary import summary
from cmr.estimation.estimation import ERRORS_ACCUMULATE
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.noise import Noise
from cmr.estimation.simulation_error import covariance_by_blocks
from tests.faulty_drive import without
from tests.html_page import Page
from tests.reference_plant import REALISTIC, packets, recording
from tests.reference_plant.manoeuvres import figure_eight

BLOCKS, LENGTH = 400, 25


@pytest.mark.parametrize(("lasts", "samples"), [(LENGTH, BLOCKS), (1, BLOCKS * LENGTH)], ids=["bursts", "white"])
def test_errors_that_come_in_bursts_count_once_a_burst(lasts: int, samples: int) -> None:
    """What a mean is known to is one over the root of how many errors there are that have causes of their own."""
    random = np.random.default_rng(5)
    rest = np.repeat(random.standard_normal(BLOCKS * LENGTH // lasts), lasts)
    fit = Fit({"k1": 0.0}, ("k1",), rest, np.ones((len(rest), 1)), Noise({}))
    blocks = np.repeat(np.arange(BLOCKS, dtype=np.float64), LENGTH)[:, None]
    assert np.sqrt(covariance_by_blocks(fit, blocks)[0, 0]) == pytest.approx(samples**-0.5, rel=0.15)


def test_where_structure_was_not_looked_for_its_share_is_not_known_and_the_reason_is_told() -> None:
    rolling = without(recording(packets(figure_eight(40.0, 3), 40.0), {}, 40.0, REALISTIC, 6), "commands")
    found = diagnose(rolling)
    assert document(found)["unexplained"] == {
        "present": False,
        "signal": None,
        "regressors": [],
        "share_of_residual_variance": None,
        "not_judged": ERRORS_ACCUMULATE,
    }
    assert "the paper's model is sufficient" not in found.sentence
    assert "Whether errors remain unexplained was not judged." in " ".join(summary(found).split())
    page = Page(report_of(found)).text
    assert f"Not judged. {ERRORS_ACCUMULATE}" in page
    assert "predict no residual" not in page
