"""What a diagnosis says of the robot as it was given, and to whom it says what to drive."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cmr.diagnosis.against_nominal import dimension_notes, worse_than_nominal
from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.document import document
from cmr.diagnosis.report import report_of
from cmr.diagnosis.result import Diagnosis, Fitted
from cmr.diagnosis.summary import summary
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recording
from tests.reference_plant import NEUTRAL, REALISTIC, packets, recording
from tests.reference_plant.manoeuvres import figure_eight
from tests.support.diagnosis_example import EXTENDED, FOUND, NOTHING
from tests.support.faulty_drive import without
from tests.support.html_page import Page

pytestmark = pytest.mark.slow

TRUE = {name: getattr(NEUTRAL, name) for name in ("wheel_radius", "k2_over_k3", "k1", "base_width")}
SECONDS = 60.0
SURELY = Gain(ratio=0.6, interval=(0.5, 0.7), signals={})
NOMINAL = Fitted(
    estimates={name: Estimate(value, math.nan) for name, value in TRUE.items()},
    path_rmse=0.210,
    held_out_path_rmse=0.220,
    held_out_path_median=0.150,
    held_out_heading_rmse=0.5,
    held_out_heading_median=0.25,
)


@cache
def drive() -> Recording:
    return recording(packets(figure_eight(SECONDS, 4), SECONDS), {}, SECONDS, REALISTIC, 3)


def given(**values: float) -> ParameterFile:
    return ParameterFile(0, {name: Value(value) for name, value in values.items()})


def with_errors(path_rmse: float, **estimates: float) -> Fitted:
    return Fitted(
        estimates={name: Estimate(value, 0.01 * value) for name, value in estimates.items()},
        path_rmse=path_rmse,
        held_out_path_rmse=path_rmse,
    )


@cache
def of_a_narrow_robot() -> Diagnosis:
    """The diagnosis of a robot without effects that was given with a base width a fifth too small."""
    return diagnose(drive(), given(**{**TRUE, "base_width": 0.8 * TRUE["base_width"]}))


@cache
def of_the_robot_as_it_is() -> Diagnosis:
    """The diagnosis of a robot without effects that was given as it is."""
    return diagnose(drive(), given(**TRUE))


def test_the_error_of_the_robot_as_it_was_given_is_measured_over_the_same_windows() -> None:
    found = of_a_narrow_robot()
    assert found.nominal is not None
    assert found.extended is not None
    assert found.gain_over_nominal is not None
    assert found.nominal.estimates["base_width"].value == pytest.approx(0.8 * TRUE["base_width"])
    assert found.nominal.held_out_path_rmse > 3.0 * found.extended.held_out_path_rmse
    ratio = found.nominal.held_out_path_rmse / found.extended.held_out_path_rmse
    assert found.gain_over_nominal.ratio == pytest.approx(ratio)
    assert found.nominal.held_out_heading_median > 3.0 * found.extended.held_out_heading_median


def test_a_base_width_far_from_the_given_one_is_told() -> None:
    (told,) = [note for note in of_a_narrow_robot().notes if note.startswith("base_width is ")]
    assert "25 % larger than the nominal" in told or "24 % larger than the nominal" in told
    assert not [note for note in of_the_robot_as_it_is().notes if "nominal" in note]


def test_a_robot_that_is_given_in_part_has_no_error_of_its_own() -> None:
    found = diagnose(drive(), given(wheel_radius=TRUE["wheel_radius"]))
    assert found.nominal is None
    assert document(found)["nominal"]["held_out_path_rmse_m"] is None
    assert document(found)["gain_over_nominal"]["held_out_path_rmse_ratio"] is None
    assert "nominal" not in summary(found)


def test_without_commands_the_motors_of_the_given_robot_need_not_be_known() -> None:
    rolling = without(drive(), "commands")
    found = diagnose(rolling, given(wheel_radius=1.25 * TRUE["wheel_radius"], base_width=TRUE["base_width"]))
    assert found.nominal is not None
    assert set(found.nominal.estimates) == {"wheel_radius", "base_width"}
    (told,) = [note for note in found.notes if note.startswith("wheel_radius is ")]
    assert "20 % smaller than the nominal" in told


def test_a_dimension_is_told_once_and_of_which_model() -> None:
    near, far = with_errors(0.1, base_width=0.52), with_errors(0.1, base_width=0.9)
    dimensions = {"base_width": 0.5}
    assert list(dimension_notes(dimensions, near, near)) == []
    (both,) = dimension_notes(dimensions, far, far)
    assert both.startswith("base_width is 0.9 m, 80 % larger than the nominal 0.5 m. A skid-steer")
    (of_paper,) = dimension_notes(dimensions, far, near)
    assert of_paper.startswith("base_width in the paper's model is 0.9 m, 80 % larger")
    (narrow,) = dimension_notes(dimensions, near, with_errors(0.1, base_width=0.4))
    assert "20 % smaller" in narrow
    assert "skid-steer" not in narrow


def test_a_fit_that_is_worse_than_what_was_given_is_told() -> None:
    nominal, worse, better = with_errors(0.072), with_errors(0.263), with_errors(0.051)
    (of_paper,) = worse_than_nominal(nominal, worse, better, Gain(ratio=1.4, interval=(1.2, 1.6), signals={}))
    assert "(0.2630 m)" in of_paper
    assert "what counts is the improvement over the nominal parameters" in of_paper
    (of_all,) = worse_than_nominal(nominal, worse, worse, SURELY)
    assert of_all.endswith("keep the nominal ones.")
    assert not list(worse_than_nominal(nominal, better, better, Gain(ratio=1.4, interval=(1.2, 1.6), signals={})))


def test_medians_headings_and_the_given_robot_stand_beside_the_path_error() -> None:
    extended = replace(EXTENDED, held_out_path_median=0.021, held_out_heading_rmse=0.1, held_out_heading_median=0.02)
    gain = Gain(ratio=5.95, interval=(5.0, 7.0), signals={"psi": 2.5})
    found = replace(FOUND, nominal=NOMINAL, extended=extended, gain_over_nominal=gain)
    text = " ".join(summary(found).split())
    assert "nominal parameters 0.2200 0.1500 28.65 14.32" in text
    assert "With the nominal parameters it is 0.2200 m; compared with that it is smaller by a factor of 5.95" in text
    page = Page(report_of(found)).text
    for told in (
        "0.220 m",
        "0.150 m",
        "28.6\u00b0",
        "5.95 (5.00 to 7.00)",
        "2.97 (2.61 to 3.30)",
        "5.95 times smaller",
    ):
        assert told in page
    content = document(found)
    assert content["nominal"]["held_out_path_median_m"] == 0.150
    assert content["gain_over_nominal"]["ci95"] == [5.0, 7.0]


def test_without_a_path_the_errors_of_other_signals_are_told() -> None:
    unknown = with_errors(math.nan)
    gain = Gain(ratio=math.nan, interval=(math.nan, math.nan), signals={"psi": 1.5, "yaw_rate": 2.0})
    text = " ".join(summary(replace(FOUND, baseline=unknown, extended=unknown, gain=gain)).split())
    assert "no path was measured on held-out data." in text
    assert "smaller by a factor of 1.50 (wheel speeds) and 2.00 (yaw rate)." in text
    assert "nan" not in text


def test_where_no_effect_is_found_the_errors_are_still_compared_with_the_given_robot() -> None:
    found = replace(NOTHING, nominal=NOMINAL, gain_over_nominal=Gain(ratio=2.0, interval=(1.8, 2.2), signals={}))
    page = Page(report_of(found))
    assert "Errors of free runs" in page.texts_of["h2"]
    assert "2.00 (1.80 to 2.20)" in page.text


def told_to_drive(found: Diagnosis) -> str:
    assert found.not_visible
    assert document(found)["not_visible"] == list(found.not_visible)
    assert found.next_experiment is not None
    return found.next_experiment


def test_the_pilots_command_is_for_a_robot_whose_driver_takes_commands_and_words_are_for_others() -> None:
    imported = drive()
    wheels = imported.wheels
    sent = {**wheels.fields, "applied_utime": (wheels.utime - 2000).astype(np.float64)}
    assert not imported.driven_on_the_bus
    assert "cmr-" not in told_to_drive(of_the_robot_as_it_is())
    assert "m of free floor around the start" in told_to_drive(of_the_robot_as_it_is())
    ours = replace(imported, wheels=replace(wheels, fields=sent))
    assert ours.driven_on_the_bus
    assert "`cmr-pilot --robot 0 " in told_to_drive(diagnose(ours, given(**TRUE)))


def test_effects_that_only_commands_show_are_not_recommended_to_be_driven_for() -> None:
    said = told_to_drive(diagnose(without(drive(), "commands"), given(**TRUE)))
    assert "Record the commands that the robot gets, too" in said
    before, _, needed = said.partition("Record the commands")
    assert "command delay" not in before.lower()
    assert "command delay" in needed
