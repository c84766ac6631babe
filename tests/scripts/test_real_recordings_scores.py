"""What docs/measurements/real_recordings.md says (../shared/data; skipped where absent).

The figures are those of `scripts/score_real_data.py`, which also scores what takes too long for a test: OptiOdom with
all its sessions, and the Husky's commands on tile.
"""

from pathlib import Path

import pytest

from scripts.score_real_data import (
    DATA,
    Importer,
    Score,
    score_husky_tile,
    score_husky_wet_grass,
    score_maebot,
    score_mbot,
    score_optiodom,
)

pytestmark = pytest.mark.slow

Scores = dict[str, Score]


@pytest.fixture
def importer(tmp_path: Path) -> Importer:
    if not DATA.is_dir():
        pytest.skip(f"measured data is not here: {DATA}")
    return Importer(DATA, tmp_path)


def by_name(scores: list[Score]) -> Scores:
    return {score.what: score for score in scores}


def test_motors_of_the_mbot_are_found_as_well_as_by_plain_least_squares(importer: Importer) -> None:
    scores = by_name(score_mbot(importer))
    assert scores["PWM to left wheel speed"].found < 0.098
    assert scores["PWM to right wheel speed"].found < 0.0695


@pytest.mark.further  # tests/diagnosis/test_real_robots.py diagnoses this robot
def test_the_maebot_rolls_where_lidar_sees_it(importer: Importer) -> None:
    whole, _ends, _whole_by_pieces, ends_by_pieces = score_maebot(importer)
    # One long drive tells the whole run best, short pieces the short run.
    assert whole.found < 1.05 * 0.305  # m, plain least squares of the same half
    assert ends_by_pieces.found < 0.0275


@pytest.mark.further  # twelve seconds; other recordings are scored here
def test_two_sessions_of_optiodom_give_its_authors_base_width_and_wheel_diameter(importer: Importer) -> None:
    scores = by_name(score_optiodom(importer, sessions=1))
    assert scores["base width, all runs"].found == pytest.approx(0.2009, rel=0.01)
    assert scores["wheel diameter, all runs"].found == pytest.approx(0.0833, rel=0.01)
    for score in scores.values():
        if "path error" in score.what:
            assert score.nominal is not None
            assert score.found < 0.8 * score.nominal


@pytest.mark.further  # half a minute; tests/diagnosis/test_real_robots.py diagnoses this drive
def test_the_husky_on_tile_turns_as_its_wheels_say(importer: Importer) -> None:
    distance, heading = score_husky_tile(importer, by_wheels=True)
    assert distance.found < 0.112
    assert heading.found < 2.0


@pytest.mark.further  # tests/diagnosis/test_real_robots.py diagnoses this drive
def test_commands_predict_the_husky_on_wet_grass(importer: Importer) -> None:
    distance, heading, speed = score_husky_wet_grass(importer)
    assert heading.found < 17.2
    assert distance.median is not None
    assert distance.median < 0.327
    assert speed.found < 0.63
