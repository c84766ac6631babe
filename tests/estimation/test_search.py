"""The parts of the search for effects: moments, places, roughness, noise and doubtful data."""

from dataclasses import replace

import numpy as np
import pytest

from cmr.diagnosis.diagnose import diagnose
from cmr.estimation.checks import looked_at, refusal, with_clocks_set
from cmr.estimation.problem import LARGE, tempered
from cmr.estimation.search.cross_validation import Elsewhere, why_not_of_moments
from cmr.estimation.search.localisation import best_moment, best_place
from cmr.estimation.search.profile import parabola
from tests.hidden_effects import hidden_recording

COUNT = 4000
TWO_DRIVES = ("figure_eight", "steps")


def test_the_moment_of_a_change_is_found() -> None:
    """An effect that sets in at 70 s of 120 s is found there, to a second, in noise as large as it."""
    random = np.random.default_rng(1)
    time = np.linspace(0.0, 120.0, COUNT)
    move = random.standard_normal(COUNT)
    rest = -0.5 * move * (time > 70.0) + random.standard_normal(COUNT)
    found = best_moment(move[:, None], rest, np.zeros((COUNT, 0)), time)
    assert found.values["time"] == pytest.approx(70.0, abs=1.0)
    assert np.array_equal(found.inside, time >= found.values["time"])


def test_the_place_of_a_patch_is_found() -> None:
    """An effect within 0.4 m of a point is found there, to 10 cm."""
    random = np.random.default_rng(2)
    places = random.uniform(-1.5, 1.5, (COUNT, 2))
    move = random.standard_normal(COUNT)
    inside = np.hypot(places[:, 0] - 1.0, places[:, 1] + 0.5) < 0.4
    rest = -2.0 * move * inside + random.standard_normal(COUNT)
    found = best_place(move[:, None], rest, np.zeros((COUNT, 0)), places)
    assert found.values["x"] == pytest.approx(1.0, abs=0.1)
    assert found.values["y"] == pytest.approx(-0.5, abs=0.1)
    assert found.values["radius"] == pytest.approx(0.4, abs=0.11)


def mostly_within(acts_outside: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return moves (n, 1) that are large within 0.4 m of a point, what is to be explained, and where."""
    random = np.random.default_rng(4)
    places = random.uniform(-1.5, 1.5, (COUNT, 2))
    inside = np.hypot(places[:, 0] - 1.0, places[:, 1] + 0.5) < 0.4
    move = np.where(inside, 6.0, 1.0) * random.standard_normal(COUNT)
    assert np.sum(move[inside] ** 2) > 0.6 * np.sum(move**2)
    return move[:, None], -move * np.where(inside, 1.0, acts_outside) + random.standard_normal(COUNT), places


def test_a_place_may_hold_most_of_what_an_effect_does() -> None:
    """A robot that hardly gets away from where friction holds it leaves most of its evidence there."""
    moves, rest, places = mostly_within(acts_outside=0.0)
    found = best_place(moves, rest, np.zeros((COUNT, 0)), places)
    assert (found.values["x"], found.values["y"]) == pytest.approx((1.0, -0.5), abs=0.1)


def test_what_acts_everywhere_is_no_place_where_most_of_it_shows() -> None:
    moves, rest, places = mostly_within(acts_outside=1.0)
    found = best_place(moves, rest, np.zeros((COUNT, 0)), places)
    # Discs that hold more than 0.6 of it would have to explain more than everywhere does.
    assert found.drop < 0.7 * float(moves[:, 0] @ rest) ** 2 / float(moves[:, 0] @ moves[:, 0])


def test_what_the_model_can_do_itself_is_no_evidence() -> None:
    """A move along the model's own slopes explains nothing more, wherever it acts throughout."""
    random = np.random.default_rng(3)
    move = random.standard_normal(COUNT)
    basis = (move / np.linalg.norm(move))[:, None]
    rest = random.standard_normal(COUNT)
    rest -= basis[:, 0] * (basis[:, 0] @ rest)
    found = best_moment(move[:, None], rest, basis, np.linspace(0.0, 100.0, COUNT))
    # The largest of many scores of chance, each chi-squared with one degree of freedom, stays below 30.
    assert found.drop < 30.0


def test_steps_in_the_valley_widen_the_interval() -> None:
    """On smooth ground a scan adds nothing to the standard deviation; steps add more the higher they are."""
    offsets = np.linspace(-1.0, 1.0, 16)
    smooth = 100.0 * offsets**2
    steps = 50.0 * (offsets > 0.2)
    assert parabola(offsets, smooth)[0] < 1e-6
    small, large = parabola(offsets, smooth + steps)[0], parabola(offsets, smooth + 3.0 * steps)[0]
    assert 0.0 < small < large


def test_nothing_is_known_of_the_lowest_point_where_the_model_holds_nowhere() -> None:
    assert parabola(np.linspace(-1.0, 1.0, 41), np.full(41, np.inf)) == (1.0, np.inf)


def test_large_errors_are_tempered_and_small_ones_kept() -> None:
    """Below the limit errors stay as they are; above, their squares grow in proportion to the error."""
    errors = np.array([0.5, -LARGE, 10.0 * LARGE, -100.0 * LARGE])
    squares = tempered(errors) ** 2
    assert np.allclose(squares[:2], errors[:2] ** 2)
    assert np.allclose(squares[2:], 2.0 * LARGE * np.abs(errors[2:]) - LARGE**2)


def test_a_clock_that_is_far_off_is_set_and_said() -> None:
    """Poses stamped 2 s late are moved back to within 50 ms, with a sentence."""
    recording = hidden_recording(manoeuvre="rich", seed=1).recording
    late = replace(recording, poses=replace(recording.poses, utime=recording.poses.utime + 2_000_000))
    mended, _, note = with_clocks_set(late)
    assert note == "The poses are stamped 2.00 s later than the wheels: their times were corrected."
    assert abs(int(mended.poses.utime[0]) - int(recording.poses.utime[0])) < 50_000


def test_a_mirrored_reference_is_refused_not_explained() -> None:
    """Poses with y to the right are told as such: bad data, no effect, no parameters."""
    recording = hidden_recording(manoeuvre="rich", seed=1).recording
    fields = {**recording.poses.fields, "y": -recording.poses["y"], "theta": -recording.poses["theta"]}
    found = diagnose(replace(recording, poses=replace(recording.poses, fields=fields)))
    assert found.verdict == "bad_data"
    assert "mirrored" in found.sentence
    assert found.extended is None


def test_data_without_wheels_and_commands_are_refused() -> None:
    """The sentence says what is missing."""
    recording = hidden_recording(manoeuvre="rich", seed=1).recording
    blind = replace(recording, wheels=recording.wheels.between(0, 1))
    assert not refusal(looked_at([blind]))
    blind = replace(blind, commands=recording.commands.between(0, 1))
    assert "MOTOR_FEEDBACK_N" in refusal(looked_at([blind]))


@pytest.mark.slow
def test_a_drive_that_does_not_show_an_effect_says_nothing_against_it() -> None:
    drives = [hidden_recording("current_limit", manoeuvre=drive, seed=1, run=k) for k, drive in enumerate(TWO_DRIVES)]
    found = diagnose([drive.recording for drive in drives])
    assert [effect.name for effect in found.effects] == ["current_limit"]
    limit = found.effects[0].estimates["current_limit"]
    assert limit.value == pytest.approx(drives[0].truth.parameters["current_limit"], abs=3.0 * limit.std)


@pytest.mark.parametrize(
    ("drops", "gains", "holds"),
    [
        ((0.0, 2e5), (0.0, 50.0), True),  # seen in one drive only, which helps the other
        ((0.0, 2e5), (-1e6, -50.0), True),  # what a drive makes up that does not show it is no argument
        ((0.0, 2e5), (0.0, -2e4), False),  # what one drive finds ruins the other
        ((100.0, 100.0), (30.0, -40.0), False),
        ((20.0, 20.0), (5.0, 5.0), True),  # neither speaks for it alone, each helps the other
        ((20.0, 20.0), (5.0, -6.0), False),
        ((20.0, 1.0), (5.0, 5.0), False),
    ],
)
def test_what_one_drive_finds_must_not_ruin_another(
    drops: tuple[float, float], gains: tuple[float, float], holds: bool
) -> None:
    assert (why_not_of_moments(Elsewhere(drops, gains, 0.5, 0.0), 35.0) == "") == holds
