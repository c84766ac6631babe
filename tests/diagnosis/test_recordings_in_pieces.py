"""Recordings as other people publish them: short pieces that begin in motion, each with its pose set to 0, 0, 0."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from cmr.calibration import CalibrationResult, EstimationError, calibrate
from cmr.calibration.calibrate import first_that_helps
from cmr.diagnosis.diagnose import diagnose
from cmr.parameters.file import ParameterFile, Value
from cmr.plant.sensors import REALISTIC
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Signal
from tests.hidden_effects.pieces import in_pieces
from tests.hidden_effects.robots import draw_nominal, draw_robot
from tests.reference_plant import drives
from tests.reference_plant.manoeuvres import RICH_DRIVE_SECONDS, rich_drive
from tests.support.lanes import further

pytestmark = pytest.mark.slow

CERTAIN = 3.5  # standard deviations
CLOCK = 0.002  # s; poses are stamped on a raster of their own, commands are sent on another


def driven(hidden: Mapping[str, float], seed: int) -> Recording:
    random = np.random.default_rng([seed, 20])
    robot = draw_robot(random)
    nominal = ParameterFile(0, {name: Value(value) for name, value in draw_nominal(robot, random).items()})
    commands = drives.packets(rich_drive(), RICH_DRIVE_SECONDS)
    return drives.drive(commands, {**robot, **hidden}, RICH_DRIVE_SECONDS, REALISTIC, seed, nominal=nominal).recording


def without_commands(recording: Recording) -> Recording:
    untold = {"applied_left": np.nan, "applied_right": np.nan}
    wheels = {name: np.full(len(values), untold.get(name, 0.0)) for name, values in recording.wheels.fields.items()}
    told = {name: values for name, values in recording.wheels.fields.items() if name not in untold}
    none = Signal(np.empty(0, np.int64), {name: np.empty(0) for name in recording.commands.fields})
    return replace(recording, commands=none, wheels=Signal(recording.wheels.utime, {**wheels, **told}))


@pytest.mark.further  # whole recordings: tests/estimation/test_search.py
@pytest.mark.parametrize(("seconds", "commanded"), [(2.0, False), (6.0, True)])
def test_poses_are_as_late_as_they_are_however_the_drive_is_cut(seconds: float, commanded: bool) -> None:
    pieces = in_pieces(driven({"pose_latency": 0.22}, 1), seconds)
    found = diagnose([pieces if commanded else without_commands(pieces)])
    assert [effect.name for effect in found.effects] == ["pose_latency"]
    latency = found.effects[0].estimates["pose_latency"]
    assert latency.value == pytest.approx(0.22, abs=CERTAIN * latency.std + CLOCK)


@pytest.mark.further  # the Husky itself: test_real_robots.py
def test_travel_that_turning_costs_is_neither_distortion_nor_a_smaller_wheel() -> None:
    found = diagnose([in_pieces(driven({"travel_reduction_share": 0.2, "pose_offset": 0.1}, 2), 3.0)])
    assert {effect.name for effect in found.effects} == {"pose_offset", "travel_reduction"}
    share = next(e for e in found.effects if e.name == "travel_reduction").estimates["travel_reduction_share"]
    assert share.value == pytest.approx(0.2, abs=CERTAIN * share.std)


@pytest.mark.further  # test_windowed_recordings.py has such pieces
def test_what_belongs_to_a_frame_is_not_looked_for_in_pieces_that_have_one_each() -> None:
    whole = driven({"pose_distortion": 0.03}, 3)
    assert [effect.name for effect in diagnose([whole]).effects] == ["pose_distortion"]
    found = diagnose([in_pieces(whole, 4.0)])
    seen = {one.name for one in found.effects} | {one.name for one in found.candidates}
    assert not seen & {"pose_distortion", "slope", "surface_patch"}


def test_a_calibration_that_would_be_worse_than_what_was_given_is_not_taken() -> None:
    def result(after: float) -> CalibrationResult:
        return cast(CalibrationResult, SimpleNamespace(path_rmse_before=0.1, path_rmse_after=after))

    good, worse, worst = result(0.09), result(0.2), result(0.3)
    assert first_that_helps(iter([good, worse])) is good
    assert first_that_helps(iter([worse, good])) is good
    with pytest.raises(EstimationError, match=r"The given parameters stay: .*0\.200 m.*0\.100 m"):
        first_that_helps(iter([worst, worse]))


@pytest.mark.parametrize("lag", further(0.2, 0.4))
def test_wheels_that_are_stamped_late_do_not_make_the_robot_worse(lag: float) -> None:
    whole = driven({}, 0)
    late = replace(whole, wheels=Signal(whole.wheels.utime + round(1e6 * lag), dict(whole.wheels.fields)))
    true = draw_robot(np.random.default_rng([0, 20]))
    given = ParameterFile(0, {name: Value(value) for name, value in true.items()})
    with suppress(EstimationError):
        result = calibrate(in_pieces(late, 2.0), given)
        assert result.path_rmse_after < 1.1 * result.path_rmse_before + 0.003


@pytest.mark.further  # other tests of this file cut recordings, too
def test_commands_and_poses_without_wheels_tell_what_they_tell() -> None:
    whole = driven({"motor_gain_asymmetry": 0.03, "pose_latency": 0.1}, 5)
    none = Signal(np.empty(0, np.int64), {name: np.empty(0) for name in whole.wheels.fields})
    found = diagnose([replace(whole, wheels=none)])
    assert {effect.name for effect in found.effects} == {"motor_gain_asymmetry", "pose_latency"}
    for effect in found.effects:
        for name, one in effect.estimates.items():
            assert one.value == pytest.approx({"pose_latency": 0.1}.get(name, 0.03), abs=CERTAIN * one.std + CLOCK)
