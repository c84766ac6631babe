"""What the report of a diagnosis promises: a page that needs nothing beside it and can be believed."""

import math
import re
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest

from cmr.calibration.result import Estimate
from cmr.diagnosis.report import report_of, write_report
from cmr.diagnosis.report.binned import MOST_SAMPLES, binned
from cmr.diagnosis.report.found import with_commands
from cmr.diagnosis.report.numbers import chance, estimate_text, interval_text, number
from cmr.diagnosis.report.pairs import pairs_of, pairs_without
from cmr.diagnosis.report.style import AFTER, BEFORE, INK, REAL, REAL_OUTLINE
from cmr.diagnosis.report.tell_tale import REGRESSOR_WORDS, SIGNAL_WORDS, tell_tale
from cmr.diagnosis.report.terms import SYMBOLS, UNITS, as_shown, regressor, signal_words
from cmr.diagnosis.result import (
    VERDICTS,
    Diagnosis,
    Evidence,
    Fitted,
    Gain,
    GenericTerm,
    NamedEffect,
    Path,
    Residual,
    Unexplained,
)
from cmr.diagnosis.words import REGRESSORS, SIGNALS
from cmr.model.catalogue import CATALOGUE
from cmr.recordings.findings import Finding
from cmr.recordings.signal import Floats
from cmr.world.figure import REAL_COLOUR, TWIN_COLOUR
from tests.diagnosis_example import (
    ALL,
    CANDIDATES,
    CHECKS,
    EFFECTS,
    FOUND,
    MOTION,
    NOTHING,
    RATE,
    SPOILT,
    STRANGE,
    UNCHANGED,
    noise,
    path,
    residual,
    residuals,
)
from tests.html_page import Page


@pytest.fixture(scope="module")
def found() -> Page:
    return Page(report_of(FOUND))


@pytest.mark.parametrize("verdict", VERDICTS)
def test_each_verdict_gives_a_page_that_begins_with_it(verdict: str) -> None:
    page = Page(report_of(ALL[verdict]))
    assert page.texts[0] == ALL[verdict].sentence
    assert page.open == []
    assert page.texts_of["h1"] == [ALL[verdict].sentence]


@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_page_needs_nothing_from_outside_and_runs_nothing(verdict: str) -> None:
    text = report_of(ALL[verdict])
    page = Page(text)
    loading = {"src", "href", "srcset", "data", "action", "background", "poster", "xlink:href"}
    assert not [e for e in page.elements if loading & set(e[1]) or any(key.startswith("on") for key in e[1])]
    assert not {"script", "link", "iframe", "object", "embed", "form", "base"} & {name for name, _ in page.elements}
    assert not re.search(r"url\(|@import|https?:", text)
    assert {"http-equiv": "Content-Security-Policy", "content": "default-src 'none'; style-src 'unsafe-inline'"} in (
        page.named("meta")
    )


EVIL = "</style></svg><script>alert(1)</script><img src=x onerror=alert(1)>\"'&amp;"


def test_text_from_outside_cannot_become_markup() -> None:
    pair_of_evil = replace(residuals()[0], signal=EVIL, unit=EVIL, regressors={EVIL: MOTION.time})
    effect = replace(
        EFFECTS[0],
        name=EVIL,
        cause=EVIL,
        estimates={EVIL: Estimate(1.0, 0.1)},
        shift={EVIL: 0.1},
        indistinguishable_from=(EVIL,),
        next_experiment=f"{EVIL} `cmr-sim {EVIL}`",
    )
    diagnosis = replace(
        FOUND,
        verdict=EVIL,
        sentence=EVIL,
        effects=(effect,),
        candidates=(replace(CANDIDATES[0], name=EVIL, why_not=EVIL),),
        checks=(Finding(EVIL, 1, EVIL), Finding(EVIL, 0, EVIL)),
        notes=(EVIL,),
        next_experiment=EVIL,
        parameters={EVIL: 1.0},
        unexplained=Unexplained(present=True, signal=EVIL, regressors=(EVIL,), share=0.1),
        evidence=Evidence(paths=(path(EVIL),), residuals=(pair_of_evil,)),
        sources=(EVIL,),
    )
    page, harmless = Page(report_of(diagnosis)), Page(report_of(FOUND))
    assert {name for name, _ in page.elements} <= {name for name, _ in harmless.elements}
    assert {key for _, attributes in page.elements for key in attributes} <= {
        key for _, attributes in harmless.elements for key in attributes
    }
    assert page.texts[0] == EVIL
    assert page.text.count("<script>") > 10


@pytest.mark.parametrize("verdict", VERDICTS)
def test_what_is_not_known_is_never_printed_as_a_number(verdict: str) -> None:
    unknown = Estimate(math.nan, math.nan)
    blank = Fitted(estimates={"k1": unknown}, path_rmse=math.nan, held_out_path_rmse=math.nan)
    lost = np.full(len(MOTION.time), math.nan)
    diagnosis = replace(
        ALL[verdict],
        baseline=blank,
        extended=blank,
        effects=(
            NamedEffect(
                name="slew_limit",
                cause="Slow.",
                estimates={"slew_limit": Estimate(math.inf, math.inf)},
                statistic=math.nan,
                p_value=math.nan,
                shift={"k1": math.nan},
            ),
        ),
        candidates=(replace(CANDIDATES[0], statistic=math.nan, p_value=math.nan, held_out=math.nan),),
        gain=Gain(ratio=math.nan, interval=(math.nan, math.nan), signals={"psi": math.nan}),
        unexplained=Unexplained(present=True, share=math.nan),
        parameters={"slew_limit": math.inf, "k1": math.nan},
        evidence=Evidence(
            paths=(replace(path(), x=lost), replace(path(), before_x=lost, after_y=lost)),
            residuals=(
                replace(residuals()[0], before=np.full(len(MOTION.time), math.nan)),
                Residual(signal="heading", unit="rad", before=np.empty(0), after=np.empty(0), regressors={}),
                Residual(
                    signal="forward", unit="m", before=np.ones(1), after=np.ones(1), regressors={"time": np.zeros(1)}
                ),
            ),
        ),
    )
    assert not re.search(r"\b(nan|None|inf)\b", report_of(diagnosis))


def test_a_diagnosis_without_anything_still_gives_a_page() -> None:
    for verdict in VERDICTS:
        assert Page(report_of(Diagnosis(robot_id=0, verdict=verdict, sentence="So it is."))).texts[0] == "So it is."


@pytest.mark.filterwarnings("error")
def test_a_page_is_made_without_a_warning() -> None:
    for diagnosis in ALL.values():
        report_of(diagnosis)


def test_the_effects_stand_there_with_cause_size_interval_evidence_and_what_they_are_confused_with(found: Page) -> None:
    assert "The tracked point sits 0.144 m ahead" in found.text
    assert "0.1443 \u00b1 0.0021 m" in found.text
    assert "95 %: 0.1402 to 0.1484" in found.text
    assert "LR 3,110.4" in found.text
    assert "p < 10\u207b\u00b3\u2070\u2070" in found.text
    assert "lateral_skid (to tell: spins on the spot)" in found.text


def test_the_equation_of_a_named_effect_is_the_code_that_runs(found: Page) -> None:
    assert "x = x + pose_offset * cos(theta)" in found.text


def test_the_gain_is_told_with_its_interval_and_how_far_parameters_moved(found: Page) -> None:
    assert "2.97 (2.61 to 3.30)" in found.text
    assert "0.110 m" in found.text
    assert "0.037 m" in found.text
    assert "\u22120.0205 m" in found.text
    assert "\u221211.3 %" in found.text
    assert "0.00002" not in found.text  # a tenth of its standard deviation: it did not move


def test_an_error_that_grew_is_not_called_smaller() -> None:
    worse = Gain(ratio=0.8, interval=(0.7, 0.9), signals={})
    assert "none: 1.25 times larger" in Page(report_of(replace(FOUND, gain=worse))).text


def test_runners_up_say_why_they_were_not_named(found: Page) -> None:
    assert "It makes data worse that it was not fitted on." in found.text
    assert "\u221214.3" in found.text
    many = Page(report_of(replace(FOUND, candidates=CANDIDATES * 20)))
    assert "30 more effects were tried and explain less" in many.text
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
    assert "2 checks found nothing: gaps, encoder_spikes." in found.text


def test_bad_data_are_explained_before_all_else() -> None:
    headings = Page(report_of(SPOILT)).texts_of["h2"]
    assert headings[:2] == ["The data", "What to do next"]
    unnoticed = Page(report_of(replace(SPOILT, next_experiment=None, checks=CHECKS[1:])))
    assert "No check of the data found a fault" not in unnoticed.text
    assert "Mend what the first line says, and record the drive again." in unnoticed.text


def test_what_remains_unexplained_is_told_and_drawn() -> None:
    page = Page(report_of(STRANGE))
    assert "from speed v and time, 34 % of its variance can be foretold" in page.text
    assert "If you recognise the physics, add it as an effect of your own" in page.text
    drawn = [str(svg.get("aria-label")) for svg in page.named("svg")]
    assert any(alt.startswith("yaw rate \u03c9, real minus model, over speed v, over speed v") for alt in drawn)


def test_a_generic_term_is_drawn_without_and_with_it() -> None:
    name, over = "generic_motion", residuals()[2]
    gain = Gain(ratio=1.6, interval=(1.3, 2.0), signals={})
    term = GenericTerm(estimates={f"{name}_turn_abs_v": Estimate(0.1, 0.01)}, formula="", held_out=30.0, gain=gain)
    unexplained = replace(STRANGE.unexplained, generic=term)
    drawn = replace(over, before=over.after, without={name: over.before})
    page = Page(report_of(replace(STRANGE, unexplained=unexplained, evidence=Evidence(residuals=(drawn,)))))
    alts = [str(svg.get("aria-label")) for svg in page.named("svg")]
    for side in ("without", "with"):
        assert [alt for alt in alts if f"over speed v, {side} the generic term: means" in alt]


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


def test_real_paths_are_yellow_and_simulated_ones_blue_as_everywhere(found: Page) -> None:
    assert (REAL, AFTER) == (REAL_COLOUR, TWIN_COLOUR)
    strokes = [shape.get("stroke") for shape in found.named("path") if len(str(shape.get("d"))) > 2000]
    assert {REAL, AFTER} <= set(strokes)


def test_what_must_be_seen_stands_out_from_white_paper() -> None:
    for colour in (REAL_OUTLINE, BEFORE, AFTER, INK):
        assert contrast_with_white(colour) >= 3.0  # WCAG 2.1, 1.4.11


def contrast_with_white(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    red, green, blue = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return 1.05 / (0.2126 * red + 0.7152 * green + 0.0722 * blue + 0.05)


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
    page = Page(report_of(replace(FOUND, evidence=Evidence(paths=(astray,)))))
    (line,) = {str(p.get("d")) for p in page.named("path") if p.get("stroke") == REAL and "L" in str(p.get("d"))}
    assert line.count("M") == 2  # one gap
    places = np.array(re.findall(r"-?[\d.]+", line), float).reshape(-1, 2)
    assert places.min() >= 0.0
    assert np.ptp(places, axis=0).max() > 100.0  # of some 230 units


def test_hours_of_data_still_make_a_page_that_can_be_mailed() -> None:
    def longer(values: Floats) -> Floats:
        return np.tile(values, 240)  # four hours

    time = np.arange(240 * len(MOTION.time)) / RATE
    regressors = {name: longer(values) for name, values in MOTION.regressors.items()} | {"time": time}
    many = tuple(
        replace(
            r,
            before=longer(r.before),
            after=longer(r.after),
            regressors=regressors,
            without={name: longer(values) for name, values in r.without.items()},
        )
        for r in residuals()
    )
    fields = {name: longer(values) for name, values in vars(path()).items() if name not in ("label", "time")}
    run = Path(label="long.lcm", time=time, **fields)
    assert all(len(pair.before) == MOST_SAMPLES for pair in pairs_of(many))  # the work does not grow
    page = report_of(replace(FOUND, evidence=Evidence(paths=(run,) * 20, residuals=many)))
    assert len(page) < 2_000_000
    assert "The first 120 s of 14,400 s are drawn." in page
    assert "The first 4 of 20 recordings are drawn." in page


def test_a_report_is_written_as_it_is(tmp_path: FilePath) -> None:
    write_report(FOUND, tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == report_of(FOUND)


def choice(diagnosis: Diagnosis, shows_in: str) -> tuple[str, str] | None:
    pair = tell_tale(pairs_of(diagnosis.evidence.residuals), shows_in)
    return (pair.signal, pair.regressor) if pair else None


def test_the_tell_tale_plot_of_an_effect_is_the_one_that_shows_it() -> None:
    assert choice(FOUND, CATALOGUE["pose_offset"].shows_in) == ("sideways", "yaw_rate")
    assert choice(FOUND, CATALOGUE["wheel_radius_asymmetry"].shows_in) == ("yaw_rate", "speed")


def test_where_nothing_changed_no_plot_tells_a_tale() -> None:
    assert choice(NOTHING, CATALOGUE["pose_offset"].shows_in) is None
    page = Page(report_of(replace(FOUND, evidence=UNCHANGED)))
    assert "No plot of mean residuals shows it by itself." in page.text


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
    assert "No plot of mean residuals shows it by itself." in page.text


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
