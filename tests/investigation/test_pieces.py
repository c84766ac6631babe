"""Pieces of recordings: the next one is chosen by its inputs alone, and names come from fewer of them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from cmr.investigation.movements import PERIOD
from cmr.investigation.pieces import PieceByPiece, inputs_of
from cmr.parameters.file import ParameterFile, Value
from cmr.plant.sensors import REALISTIC
from cmr.recordings.recording import Recording
from tests.investigation.investigated import DrivenRobot

pytestmark = pytest.mark.slow

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
NOMINAL = ParameterFile(0, {name: Value(value) for name, value in ROBOT.items()})
SECONDS = 2.0  # s of each piece
STRAIGHT = ((0.3, 0.3), (-0.3, -0.3), (0.5, 0.5), (0.2, 0.2), (-0.5, -0.5), (0.4, 0.4), (-0.4, -0.4), (-0.2, -0.2))
SPIN = (-0.3, 0.3)
FIRST, SPINS = 4, (5, 9)  # straight pieces that are looked at first, and which numbers spins have
CHOSEN = 3  # pieces; others than spins show what else may be hidden
FINE_TICKS = replace(REALISTIC, ticks_per_turn=65536.0)  # noise of ticks turns a robot that only rolls straight on
HIDDEN = {"gyro_scale": 0.04}


def driven(robot: Mapping[str, float], sides: tuple[float, float], seed: int) -> Recording:
    """A piece of a drive: half a second one way, then the other, and so on."""
    one = DrivenRobot(robot, FINE_TICKS, seed)
    for number in range(round(SECONDS / PERIOD)):
        sign = 1.0 if int(number * PERIOD / 0.5) % 2 == 0 else -1.0
        one.drive(sign * sides[0], sign * sides[1], PERIOD)
    return one.recording()


@pytest.fixture(scope="module")
def pieces() -> list[Recording]:
    """Straight drives both ways, and two spins among them, of a robot whose gyro reads too large."""
    straight = iter(STRAIGHT)
    sides = [SPIN if number in SPINS else next(straight) for number in range(len(STRAIGHT) + len(SPINS))]
    return [driven({**ROBOT, **HIDDEN}, one, seed) for seed, one in enumerate(sides)]


def rolled(piece: Recording) -> Recording:
    """A piece of which no commands were recorded."""
    return replace(piece, commands=piece.commands.between(0, 0))


@pytest.mark.parametrize("commanded", [True, False])
def test_a_piece_that_shows_what_is_left_is_chosen_by_its_inputs(pieces: list[Recording], commanded: bool) -> None:
    """Only spins show how large a gyro reads: both are among the first three of six, and then it is named."""
    pieces = pieces if commanded else [rolled(piece) for piece in pieces]
    reading = PieceByPiece([inputs_of(piece) for piece in pieces], NOMINAL)
    for number in range(FIRST):
        reading.look(number, pieces[number])
    assert not reading.named
    chosen = []
    for _ in range(CHOSEN):
        best = reading.choose()
        assert best is not None
        chosen.append(best)
        reading.look(best, pieces[best])
    assert set(SPINS) <= set(chosen)
    assert reading.named == ("gyro_scale",)


def test_inputs_are_commands_or_wheels_where_no_commands_were_recorded(pieces: list[Recording]) -> None:
    """The inputs of an unexamined piece contain no sensor readings."""
    commanded, rolling = inputs_of(pieces[0]), inputs_of(rolled(pieces[0]))
    assert {name for name, signal in commanded.signals.items() if len(signal)} == {"commands"}
    assert {name for name, signal in rolling.signals.items() if len(signal)} == {"wheels"}


def test_all_pieces_are_looked_at_once(pieces: list[Recording]) -> None:
    """In random order, too, none comes twice, and then none is left."""
    reading = PieceByPiece([inputs_of(piece) for piece in pieces[:3]], NOMINAL, seed=3, at_random=True)
    numbers = []
    while (number := reading.choose()) is not None:
        numbers.append(number)
        reading.look(number, pieces[number])
    assert sorted(numbers) == [0, 1, 2]
    assert np.all(np.diff(sorted(numbers)) == 1)
