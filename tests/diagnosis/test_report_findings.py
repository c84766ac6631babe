"""What a report tells of a diagnosis: effects, evidence, gain, faults of the data, and what to do next."""

import math
import re
from dataclasses import replace

import pytest

from cmr.diagnosis.report import report_of
from cmr.diagnosis.report.estimate_text import estimate_text, interval_text
from cmr.diagnosis.report.found import with_commands
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.report.numbers import chance, number
from tests.support.diagnosis_example import CANDIDATES, CHECKS, EFFECTS, FOUND, SPOILT, STRANGE
from tests.support.html_page import Page
from tests.support.made_up_diagnosis import DIAGNOSIS


@pytest.fixture(scope="module")
def found() -> Page:
    return Page(report_of(FOUND))


def test_the_effects_stand_there_with_cause_size_interval_evidence_and_what_they_are_confused_with(found: Page) -> None:
    assert "The tracked point sits 0.144 m ahead" in found.text
    assert "0.1443 \u00b1 0.0021 m" in found.text
    assert "95 %: 0.1402 to 0.1484" in found.text
    assert "LR 3,110.4" in found.text
    assert "p < 10\u207b\u00b3\u2070\u2070" in found.text
    assert "lateral_skid (to distinguish them: spins on the spot)" in found.text


def test_the_equation_of_a_named_effect_is_the_code_that_runs(found: Page) -> None:
    assert "x = x + pose_offset * cos(theta)" in found.text


def test_the_gain_is_told_with_its_interval_and_how_far_parameters_moved(found: Page) -> None:
    assert "2.97 (2.61 to 3.30)" in found.text
    assert "0.110 m" in found.text
    assert "0.037 m" in found.text
    assert "0.1820 m" in found.text  # from
    assert "0.1615 m" in found.text  # to
    assert "\u221211.3 %" in found.text
    assert "0.00002" not in found.text  # a tenth of its standard deviation: it did not move


def test_an_error_that_grew_is_not_called_smaller() -> None:
    worse = Gain(ratio=0.8, interval=(0.7, 0.9), signals={})
    assert "none: 1.25 times larger" in Page(report_of(replace(FOUND, gain=worse))).text
    same = Gain(ratio=0.997, interval=(0.98, 1.03), signals={})
    assert "unchanged" in Page(report_of(replace(FOUND, gain=same))).text


def test_runners_up_say_why_they_were_not_named(found: Page) -> None:
    assert "It makes data worse that it was not fitted on." in found.text
    assert "\u221214.3" in found.text
    many = Page(report_of(replace(FOUND, candidates=CANDIDATES * 20)))
    assert "30 more effects were tested and explain less" in many.text
    nothing = replace(CANDIDATES[0], name="current_limit", statistic=0.0)
    assert "current_limit" not in Page(report_of(replace(FOUND, candidates=(*CANDIDATES, nothing)))).text


def test_what_was_given_stands_beside_both_models() -> None:
    rows = [re.sub(r"\s+", " ", row) for row in re.findall(r"<tr>.*?</tr>", report_of(FOUND), re.DOTALL)]
    (radius,) = [row for row in rows if "<code>wheel_<wbr>radius</code>" in row or "<code>wheel_radius</code>" in row]
    assert radius.count("0.04 m") == 2
    (offset,) = [row for row in rows if "tracked point ahead of the turning centre" in row]
    assert offset.count("0.1443") == 1


def test_faults_of_the_data_are_sentences_and_clean_checks_are_listed(found: Page) -> None:
    assert CHECKS[0].sentence in found.text
    assert CHECKS[1].sentence not in found.text
    assert "2 checks found no problem: gaps, encoder_spikes." in found.text


def test_bad_data_are_explained_before_all_else() -> None:
    headings = Page(report_of(SPOILT)).texts_of["h2"]
    assert headings[:2] == ["Data", "What to do next"]
    unnoticed = Page(report_of(replace(SPOILT, next_experiment=None, checks=CHECKS[1:])))
    assert "No check found a problem in the data" not in unnoticed.text
    assert "Fix the problem named in the first line, then record the drive again." in unnoticed.text


def test_what_remains_unexplained_is_told_and_drawn() -> None:
    page = Page(report_of(STRANGE))
    errors = "34 % of the variance of the one-step prediction errors of the yaw rate \u03c9"
    assert f"{errors} is predicted by speed v and time, on left-out data" in page.text
    assert (
        "If you recognise the physics in the plots of the unexplained residuals, add it as an effect of your own"
        in page.text
    )
    drawn = [str(svg.get("aria-label")) for svg in page.named("svg")]
    assert any(alt.startswith("yaw rate \u03c9, real minus model, over speed v, over speed v") for alt in drawn)


def test_effects_too_small_to_matter_are_listed_with_their_sizes() -> None:
    page = Page(report_of(DIAGNOSIS))
    assert "Seen, but too small to matter: gyro_bias 0.0018 rad/s." in page.text
    assert "Its size, 0.0018 rad/s, is below what matters here, 0.0030 rad/s." in page.text


def test_a_command_in_the_text_stands_in_a_line_to_copy() -> None:
    assert with_commands("Spin: `cmr-sim --virtual 10=spin` and wait.") == (
        "Spin: <pre><code>cmr-sim --virtual 10=spin</code></pre> and wait."
    )
    assert with_commands("Run cmr-pilot --robot 0 --behaviour follow,leader=10.") == (
        "Run <pre><code>cmr-pilot --robot 0 --behaviour follow,leader=10</code></pre>"
    )
    assert with_commands("cmr-sim can drive it.") == "cmr-sim can drive it."


def test_an_experiment_that_two_effects_ask_for_is_told_once() -> None:
    asked = "Stand still for 30 s."
    page = Page(report_of(replace(FOUND, effects=tuple(replace(e, next_experiment=asked) for e in EFFECTS))))
    assert page.text.count(asked) == 1
    assert f"For pose_offset, wheel_radius_asymmetry: {asked}" in page.text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (1234.5678, "1,235"),
        (-0.00123456, "\u22120.001235"),
        (9.99999, "10.00"),
        (1e-9, "1.000 \u00d7 10\u207b\u2079"),
        (math.inf, "\u221e"),
        (math.nan, "\u2013"),
        (None, "\u2013"),
    ],
)
def test_numbers_are_printed_as_in_a_paper(value: float | None, text: str) -> None:
    assert number(value) == text


def test_estimates_have_the_digits_that_are_known() -> None:
    assert estimate_text(Estimate(118.0, 0.8), "rad/s^2") == "118.00 \u00b1 0.80 rad/s\u00b2"
    assert estimate_text(Estimate(117.6, 12.0), "-") == "118 \u00b1 12"
    assert estimate_text(Estimate(0.04, math.nan), "m") == "0.04 m"
    assert interval_text(Estimate(0.04, math.nan)) == "\u2013"
    assert chance(0.0134) == "= 0.013"
