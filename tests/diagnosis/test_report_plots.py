"""What the plots of a report promise: they show what the text says, to everybody, and their errors are right."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from cmr.diagnosis.report import report_of
from cmr.diagnosis.report.binned import binned
from cmr.diagnosis.report.pairs import pairs_of, pairs_without
from cmr.diagnosis.report.tell_tale import REGRESSOR_WORDS, SIGNAL_WORDS, tell_tale
from cmr.diagnosis.report.terms import SYMBOLS, UNITS, as_shown, regressor, signal_words
from cmr.diagnosis.report.track import parting, track_of
from cmr.diagnosis.result import Diagnosis, Path
from cmr.diagnosis.words import REGRESSORS, SIGNALS
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.estimation.unexplained.result import GenericTerm
from cmr.model.catalogue import CATALOGUE
from cmr.recordings.signal import Floats
from cmr.report.style import AFTER, BEFORE, REAL
from tests.support.diagnosis_example import (
    EFFECTS,
    FOUND,
    MOTION,
    NOTHING,
    STRANGE,
    UNCHANGED,
    noise,
    path,
    residual,
    residuals,
)
from tests.support.html_page import Page


@pytest.fixture(scope="module")
def found() -> Page:
    return Page(report_of(FOUND))


def test_the_real_path_and_those_of_both_models_are_drawn_each_in_its_colour(found: Page) -> None:
    strokes = [shape.get("stroke") for shape in found.named("path") if len(str(shape.get("d"))) > 2000]
    assert {REAL, BEFORE, AFTER} <= set(strokes)


def test_every_plot_tells_its_content_to_those_who_cannot_see_it(found: Page) -> None:
    plots = [svg for svg in found.named("svg") if svg.get("role") == "img"]
    assert all(len(str(svg.get("aria-label"))) > 20 for svg in plots)
    outside = [svg for svg in found.named("svg") if "viewbox" in svg]
    assert all(svg.get("role") == "img" or svg.get("aria-hidden") == "true" for svg in outside)


def test_all_signals_are_shown_over_all_regressors(found: Page) -> None:
    alts = [str(svg.get("aria-label")) for svg in found.named("svg")]
    for residual_ in residuals():
        for name in residual_.regressors:
            start = f"{signal_words(residual_.signal)}, real minus model, over {regressor(name).words}, before: means"
            assert any(alt.startswith(start) for alt in alts)


def test_a_path_with_gaps_or_astray_is_drawn_around_the_real_one() -> None:
    real = path()
    gappy = np.where((real.time > 20.0) & (real.time < 25.0), math.nan, real.x)
    away = 1000.0 * real.time
    astray = replace(real, x=gappy, before_x=real.x + away, before_y=real.y - away, after_x=real.x - away)
    page = Page(report_of(replace(FOUND, evidence=replace(FOUND.evidence, paths=(astray,)))))
    lines = [str(p.get("d")) for p in page.named("path") if p.get("stroke") == REAL and "L" in str(p.get("d"))]
    line = max(lines, key=len)  # the others are of the interval in which the models differ most
    assert line.count("M") == 2  # one gap
    places = np.array(re.findall(r"-?[\d.]+", line), float).reshape(-1, 2)
    assert places.min() >= 0.0
    assert np.ptp(places, axis=0).max() > 100.0  # of some 230 units


def arcs() -> Path:
    """A robot at 1 m/s that drives straight on for 40 s, then a circle of 2 m; before, the model drives one of 4 m."""
    time = np.linspace(0.0, 60.0, 601)
    (x, y, theta), (before_x, before_y, before_theta) = (_arc(time, rate) for rate in (0.5, 0.25))
    return Path(
        label="arcs.lcm",
        time=time,
        x=x,
        y=y,
        theta=theta,
        before_x=before_x,
        before_y=before_y,
        before_theta=before_theta,
        after_x=x,
        after_y=y,
        after_theta=theta,
    )


def _arc(time: Floats, rate: float) -> tuple[Floats, Floats, Floats]:
    """Poses of a robot at 1 m/s that turns at this rate [rad/s] from 40 s on."""
    theta = rate * np.maximum(time - 40.0, 0.0)
    return np.minimum(time, 40.0) + np.sin(theta) / rate, (1.0 - np.cos(theta)) / rate, theta


def test_the_interval_in_which_the_models_differ_most_is_where_the_effect_acts() -> None:
    track = track_of(arcs())
    part = parting(track, 3.0)
    assert part
    there = track.begun_together(part)
    assert there.time[0] >= 40.0
    assert there.time[-1] - there.time[0] == pytest.approx(3.0)
    for poses in (there.before, there.after):
        assert [values[0] for values in poses] == pytest.approx([values[0] for values in there.real])
    radius, turned = np.array([2.0, 4.0]), np.array([1.5, 0.75])  # m; rad in 3 s
    ahead, left = radius * np.sin(turned), radius * (1.0 - np.cos(turned))  # where an arc ends
    apart = math.hypot(ahead[0] - ahead[1], left[0] - left[1])
    assert float(there.before.distance(there.real)[-1]) == pytest.approx(apart, rel=1e-6)
    assert float(there.after.distance(there.real)[-1]) == pytest.approx(0.0, abs=1e-9)


def test_a_free_run_that_begins_anew_is_no_difference_of_the_models() -> None:
    whole = arcs()
    again = int(np.searchsorted(whole.time, 50.0))
    sent_back = replace(whole, before_x=whole.before_x.copy(), before_y=whole.before_y.copy())
    for name in ("x", "y"):
        before, real = getattr(sent_back, f"before_{name}"), getattr(whole, name)
        before[again:] += real[again] - before[again]
    part = parting(track_of(sent_back), 3.0)
    assert part
    assert not part.start < again < part.stop


def test_models_that_are_alike_have_no_such_interval() -> None:
    real = arcs()
    alike = replace(real, before_x=real.x, before_y=real.y, before_theta=real.theta)
    assert parting(track_of(alike), 3.0) is None


def test_the_caption_says_where_the_models_differ_and_what_makes_the_difference() -> None:
    page = Page(report_of(replace(FOUND, evidence=replace(FOUND.evidence, paths=(arcs(),), window=3.0))))
    [words] = [text for text in page.texts if "in which the two models differ most" in text]
    assert "Marked are the 3.0 s" in words
    assert "the robot drives 3.00 m and turns through 86\u00b0." in words
    assert "the extended model 0 m." in words
    assert "The difference comes from pose_offset, wheel_radius_asymmetry." in page.text


def choice(diagnosis: Diagnosis, shows_in: str) -> tuple[str, str] | None:
    pair = tell_tale(pairs_of(diagnosis.evidence.residuals), shows_in)
    return (pair.signal, pair.regressor) if pair else None


def test_the_tell_tale_plot_of_an_effect_is_the_one_that_shows_it() -> None:
    assert choice(FOUND, CATALOGUE["pose_offset"].shows_in) == ("sideways", "yaw_rate")
    assert choice(FOUND, CATALOGUE["wheel_radius_asymmetry"].shows_in) == ("yaw_rate", "speed")


def test_where_nothing_changed_no_plot_tells_a_tale() -> None:
    assert choice(NOTHING, CATALOGUE["pose_offset"].shows_in) is None
    page = Page(report_of(replace(FOUND, evidence=UNCHANGED)))
    assert "No plot of mean residuals shows this effect on its own." in page.text


def test_each_effect_has_a_plot_of_its_own_without_and_with_it(found: Page) -> None:
    pairs = [tell_tale(pairs_without(residuals(), e.name), CATALOGUE[e.name].shows_in) for e in EFFECTS]
    assert [(p.signal, p.regressor) for p in pairs if p] == [("sideways", "yaw_rate"), ("yaw_rate", "speed")]
    for pair, effect in zip(pairs, EFFECTS, strict=True):
        assert pair
        assert pair.removed > 0.5
        words = f"{signal_words(pair.signal)}, real minus model, over {regressor(pair.regressor).words}"
        alts = [str(svg.get("aria-label")) for svg in found.named("svg")]
        for side in ("without", "with"):
            assert [alt for alt in alts if alt.startswith(f"{words}, {side} the effect: means")]
        assert f"{effect.name}: residual of the" in found.text


def test_an_effect_of_chance_that_no_model_can_switch_off_has_no_plot() -> None:
    assert pairs_without(residuals(), "command_jitter") == ()
    page = Page(report_of(replace(FOUND, effects=(replace(EFFECTS[0], name="command_jitter"),))))
    assert "No plot of mean residuals shows this effect on its own." in page.text


def test_without_words_on_where_an_effect_shows_the_larger_structure_is_chosen() -> None:
    small, large = residual("forward", 7, 0.05, 0.02 * MOTION.speed), residual("heading", 8, 0.05, MOTION.speed)
    pair = tell_tale(pairs_of((small, large)), "")
    assert pair
    assert pair.signal == "heading"


def test_the_choice_listens_for_words_that_the_catalogue_says_and_names_that_residuals_have() -> None:
    said = [effect.shows_in for effect in CATALOGUE.values()]
    for words in (SIGNAL_WORDS, REGRESSOR_WORDS):
        assert [phrase for phrase in words if not any(phrase in text for text in said)] == []
    assert {name for names in SIGNAL_WORDS.values() for name in names} <= set(SIGNALS)
    assert {name for names in REGRESSOR_WORDS.values() for name in names} <= set(REGRESSORS)
    assert list(UNITS) == list(REGRESSORS)
    assert set(SYMBOLS) <= {*SIGNALS, *REGRESSORS}


def test_a_generic_term_is_drawn_without_and_with_it() -> None:
    name, over = "generic_motion", residuals()[2]
    gain = Gain(ratio=1.6, interval=(1.3, 2.0), signals={})
    term = GenericTerm(estimates={f"{name}_turn_abs_v": Estimate(0.1, 0.01)}, formula="", held_out=30.0, gain=gain)
    unexplained = replace(STRANGE.unexplained, generic=term)
    drawn = replace(over, before=over.after, without={name: over.before})
    page = Page(
        report_of(replace(STRANGE, unexplained=unexplained, evidence=replace(FOUND.evidence, residuals=(drawn,))))
    )
    alts = [str(svg.get("aria-label")) for svg in page.named("svg")]
    for side in ("without", "with"):
        assert [alt for alt in alts if f"over speed v, {side} the generic term: means" in alt]


@pytest.mark.parametrize("name", ["time", "speed", "yaw_rate", "x", "wheel_angle_left"])
def test_standard_errors_are_right_for_errors_that_last(name: str) -> None:
    over = as_shown(name, MOTION.regressors[name])
    many = [binned(over, noise(seed, 1.0)) for seed in range(40)]
    assert float(np.std(np.concatenate([bins.mean / bins.error for bins in many]))) == pytest.approx(1.0, abs=0.3)


def test_a_bin_with_too_little_data_has_no_mean() -> None:
    over = np.where(np.arange(3000) < 20, 5.0, np.linspace(0.0, 1.0, 3000))  # 20 samples, all in one go
    bins = binned(over, noise(1, 1.0))
    assert np.count_nonzero(np.isfinite(bins.mean)) >= 2
    assert np.all(np.isnan(bins.mean[bins.centre > 1.4]))
