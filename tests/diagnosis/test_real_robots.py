"""What the diagnosis promises of real robots' recordings (../shared/data; skipped where absent).

The figures are those of `scripts/diagnose_real_data.py`, which uses all of each recording. Errors are of parts that
nothing was fitted on.
"""

from pathlib import Path

import pytest

from scripts.diagnose_real_data import (
    Case,
    Score,
    husky_tile,
    husky_wet_grass,
    maebot,
    mbot,
    optiodom,
)
from scripts.score_real_data import DATA, Importer

pytestmark = pytest.mark.slow


@pytest.fixture
def importer(tmp_path: Path) -> Importer:
    if not DATA.is_dir():
        pytest.skip(f"measured data is not here: {DATA}")
    return Importer(DATA, tmp_path)


def score(case: Case, what: str) -> Score:
    return next(score for score in case.scores if score.what == what)


@pytest.mark.further  # scripts/diagnose_real_data.py does the same
def test_the_tracked_point_of_the_husky_is_found_ahead_of_its_turning_centre(importer: Importer) -> None:
    case, _ = husky_tile(importer, every=8)
    # Wheels and poses are some 0.2 s older than the gyro: their turns correlate best so far apart, over all windows.
    assert case.names[0] == "pose_offset"
    others = {"wheel_radius_asymmetry", "wheel_speed_latency", "pose_latency"}
    assert others <= set(case.names) <= {"pose_offset", "gyro_bias", *others}
    assert case.value("wheel_speed_latency") == pytest.approx(0.2, abs=0.05)
    assert case.value("pose_latency") == pytest.approx(0.2, abs=0.05)
    assert case.value("pose_offset") == pytest.approx(0.144, abs=0.01)
    assert case.value("wheel_radius_asymmetry") > 0.0
    assert score(case, "position after 2 s").gone > 0.6


@pytest.mark.further  # twenty seconds; test_commanded_speeds.py finds such a limit and such a delay
def test_what_limits_and_delays_the_husky_on_wet_grass_is_found(importer: Importer) -> None:
    case = husky_wet_grass(importer)
    assert case.names[:2] == ["turn_rate_limit", "command_delay"]
    assert case.value("turn_rate_limit") == pytest.approx(1.0, abs=0.03)
    delay = case.diagnosis.effects[1].estimates["command_delay"]
    assert delay.value == pytest.approx(0.2, abs=0.03)
    assert abs(delay.value - 0.2) < 1.96 * delay.std
    heading = score(case, "heading after 3 s")
    assert heading.gone > 0.5
    assert heading.after < 8.6


@pytest.mark.further  # half a minute; test_real_recordings_scores.py calibrates this drive
def test_dry_friction_of_the_mbots_motors_and_the_bias_of_its_gyro_are_found(importer: Importer) -> None:
    case = mbot(importer, rest=20.0)
    assert {"coulomb_friction", "gyro_bias"} <= set(case.names)
    assert case.value("gyro_bias") == pytest.approx(-0.0047, abs=0.0003)  # rad/s; -0.27 degrees per second
    assert score(case, "left wheel").gone > 0.55
    assert score(case, "right wheel").gone > 0.6


@pytest.mark.further  # test_recordings_in_pieces.py has such recordings
def test_nothing_is_named_that_holds_on_circles_or_on_squares_alone(importer: Importer) -> None:
    case = optiodom(importer, sessions=2)
    assert not {"turn_slip", "turn_asymmetry"} & set(case.names)
    for path in case.scores:
        assert path.after < 1.01 * path.before


def test_nothing_but_unlike_wheels_and_a_scanner_askew_is_named_of_the_maebot(importer: Importer) -> None:
    # The half that is left out, fitted by itself, has its scanner as much askew: 0.022 +- 0.012 rad.
    case = maebot(importer)
    assert set(case.names) <= {"wheel_radius_asymmetry", "pose_heading_offset"}
    assert case.diagnosis.parameters.get("pose_heading_offset", 0.022) == pytest.approx(0.022, abs=0.012)
    assert score(case, "position after 5 s").gone > 0.0
