"""Wheel speeds whose unit contradicts the ticks are noted, with the unit in which they would agree."""

import math
from pathlib import Path
from typing import Any

import pytest

from tests.tools.importing.import_bench import CSV_HEAD, NOMINAL, run, write_csv

TICKS_PER_TURN = 512
STEP = 0.05  # s
SPEED = 6.0  # rad/s, to and fro


def recording(folder: Path, gain: float) -> Path:
    """Write a drive whose wheels report their speeds in another unit: `gain` of it is one rad/s."""
    lines = ["t,ticks,speed"]
    for k in range(200):
        t = STEP * k
        angle, speed = SPEED * math.sin(t), SPEED * math.cos(t)
        lines.append(f"{t:.3f},{round(angle / (2 * math.pi) * TICKS_PER_TURN)},{gain * speed:.6f}")
    return write_csv(folder, "\n".join(lines) + "\n")


def mapping(unit: str) -> dict[str, Any]:
    sides = ("left", "right")
    return {
        **CSV_HEAD,
        "motor_feedback": {
            "ticks_per_turn": TICKS_PER_TURN,
            **{f"ticks_{side}": {"column": "ticks", "unit": "ticks"} for side in sides},
            **{f"psi_{side}": {"column": "speed", "unit": unit} for side in sides},
        },
    }


@pytest.mark.parametrize(
    ("gain", "unit", "times", "remedy"),
    [
        (1.0, "m/s", "20 times", "in rad/s they agree"),
        (NOMINAL["wheel_radius"], "rad/s", "0.05 times", "in m/s they agree"),
        (60.0 / (2 * math.pi), "rad/s", "9.6 times", "in rpm they agree"),
    ],
)
def test_a_wrong_unit_is_noted_with_the_one_that_agrees(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], gain: float, unit: str, times: str, remedy: str
) -> None:
    run(tmp_path, mapping(unit), recording(tmp_path, gain))
    said = capsys.readouterr().out
    assert f"the wheel speeds (psi_left, psi_right in {unit}) are {times} what the ticks say" in said
    assert remedy in said


def test_a_wheel_that_no_unit_explains_is_noted_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path, mapping("rad/s"), recording(tmp_path, 4.0))
    said = capsys.readouterr().out
    assert "so one of these units is wrong" in said
    assert "they agree" not in said


def test_speeds_of_the_opposite_sign_are_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path, mapping("rad/s"), recording(tmp_path, -1.0))
    assert "opposite signs: change `sign` of one of them" in capsys.readouterr().out


def test_coarse_encoders_that_count_less_than_a_tick_a_reading_agree(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["t,ticks,speed", *(f"{0.02 * k:.2f},{int(3.0 * 0.02 * k / (2 * math.pi) * 40)},3.0" for k in range(3000))]
    coarse = mapping("rad/s")
    coarse["motor_feedback"]["ticks_per_turn"] = 40
    run(tmp_path, coarse, write_csv(tmp_path, "\n".join(lines) + "\n"))
    assert "note:" not in capsys.readouterr().out


def test_nothing_is_noted_where_both_agree(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path, mapping("rad/s"), recording(tmp_path, 1.0))
    assert "note:" not in capsys.readouterr().out
