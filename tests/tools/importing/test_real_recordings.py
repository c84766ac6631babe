"""Promises of the shipped mappings, kept on recordings that nobody here made (../shared/data; skipped where absent)."""

import math
from pathlib import Path
from typing import Any

import lcm
import numpy as np
import pytest
from numpy.typing import NDArray

from cmr.bus.messages import decode
from cmr_tools.importing.import_log import main
from cmr_tools.importing.mapping import load
from tests.support.project import PROJECT

pytestmark = pytest.mark.slow

DATA = PROJECT.parent / "shared" / "data"
RECORDINGS = {
    "maebot": "maebot_convex/convex.log",
    "mbot": "mbot_square/drive_square.log",
    "optiodom": "optiodom/square/231220200048_run-01.csv.gz",
    "husky_tile": "husky_tile/husky_tile.csv.gz",
    "husky_wet_grass": "husky_wet_grass/husky_wet_grass.csv.gz",
}
COUNTS = {
    "maebot": {"MOTOR_FEEDBACK": 3421, "GYRO": 1376, "POSE": 457},
    "mbot": {"MOTOR_FEEDBACK": 8977, "GYRO": 8977, "MOTOR_COMMAND": 8977},
    "optiodom": {"MOTOR_FEEDBACK": 1387, "POSE": 1388},
    "husky_tile": {
        "MOTOR_FEEDBACK": 24_000,
        "GYRO": 24_000,
        "WHEEL_SPEED_COMMAND": 24_000,
        "POSE": 11_692,
    },
    "husky_wet_grass": {"MOTOR_FEEDBACK": 12_920, "VELOCITY_COMMAND": 12_920, "POSE": 6385},
}

Columns = dict[str, NDArray[Any]]


class Imported:
    """One recording, imported: arrays by stream and field, and `turned`, each wheel's angle from its ticks [rad]."""

    def __init__(self, name: str, folder: Path, recording: str) -> None:
        path = DATA / recording
        if not path.exists():
            pytest.skip(f"measured data is not here: {path}")
        out = folder / f"{name}.lcm"
        assert main([name, str(path), "--out", str(out)]) == 0
        messages: dict[str, list[Any]] = {}
        for event in lcm.EventLog(str(out), "r"):
            received = decode(event.channel, event.data)
            messages.setdefault(received.stream.name, []).append(received.message)
        self.mapping = load(name)
        self.streams: dict[str, Columns] = {
            stream: {field: np.array([getattr(m, field) for m in listed]) for field in listed[0].__slots__}
            for stream, listed in messages.items()
        }

    def seconds(self, stream: str) -> NDArray[np.float64]:
        return np.asarray(self.streams[stream]["utime"] - self.streams["PARAMETERS"]["utime"][0], np.float64) / 1e6

    def distance(self, side: str) -> NDArray[np.float64]:
        """Distance rolled by a side's wheel since the first row, from its ticks. [m]"""
        assert self.mapping.feedback is not None
        turns = self.streams["MOTOR_FEEDBACK"][f"ticks_{side}"] / self.mapping.feedback.ticks_per_turn
        return np.asarray(turns * 2 * math.pi * self.mapping.nominal["wheel_radius"], np.float64)

    def encoder_heading(self) -> NDArray[np.float64]:
        return (self.distance("right") - self.distance("left")) / self.mapping.nominal["base_width"]

    def encoder_path(self) -> float:
        return float(np.abs(np.diff((self.distance("left") + self.distance("right")) / 2)).sum())

    def pose_heading(self) -> NDArray[np.float64]:
        return np.unwrap(self.streams["POSE"]["theta"])

    def gyro_heading(self) -> NDArray[np.float64]:
        seconds, rate = self.seconds("GYRO"), self.streams["GYRO"]["yaw_rate"]
        return np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(seconds))])


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return a function that imports a recording by the mapping's name, once."""
    done: dict[str, Imported] = {}

    def get(name: str) -> Imported:
        if name not in done:
            done[name] = Imported(name, tmp_path_factory.mktemp(name), RECORDINGS[name])
        return done[name]

    return get


@pytest.mark.parametrize("name", sorted(RECORDINGS))
def test_every_row_that_is_a_measurement_becomes_a_message(imported: Any, name: str) -> None:
    utimes = {stream: columns["utime"] for stream, columns in imported(name).streams.items()}
    counts = {stream: len(utime) for stream, utime in utimes.items()}
    seconds = np.unique((np.concatenate(list(utimes.values())) - utimes["PARAMETERS"][0]) // 1_000_000)
    assert counts == COUNTS[name] | {"PARAMETERS": len(seconds)}, "parameters are announced each second"


@pytest.mark.parametrize("name", sorted(RECORDINGS))
def test_all_times_are_on_one_clock_and_arrival_is_never_before_measurement(imported: Any, name: str) -> None:
    robot = imported(name)
    begins = [robot.seconds(stream)[0] for stream in robot.streams]
    ends = [robot.seconds(stream)[-1] for stream in robot.streams]
    assert max(begins) < 0.5
    assert max(ends) - min(ends) < 1.0
    for columns in robot.streams.values():
        if "received_utime" in columns:
            assert (columns["received_utime"] >= columns["utime"]).all()


@pytest.mark.parametrize("name", sorted(RECORDINGS))
def test_angle_of_the_ticks_and_integral_of_the_speeds_agree(imported: Any, name: str) -> None:
    robot = imported(name)
    feedback, seconds = robot.streams["MOTOR_FEEDBACK"], robot.seconds("MOTOR_FEEDBACK")
    within = np.diff(seconds) < 1.0  # between the tile's windows nothing turns
    for side in ("left", "right"):
        psi = feedback[f"psi_{side}"]
        integral = np.cumsum(np.where(within, (psi[1:] + psi[:-1]) / 2 * np.diff(seconds), 0.0))
        rolled = (robot.distance(side) - robot.distance(side)[0])[1:] / robot.mapping.nominal["wheel_radius"]
        # The MBot computes its speeds with a fixed cycle, which is half a percent off the measured one.
        assert integral == pytest.approx(rolled, abs=0.005 * np.abs(rolled).max() + 0.3)


@pytest.mark.parametrize("name", ["mbot", "husky_tile", "husky_wet_grass"])
def test_commands_stay_below_the_top_speed_and_move_the_wheels_forward(imported: Any, name: str) -> None:
    robot = imported(name)
    commanded, top, feedback = wheels_commanded(robot), top_of(robot), robot.streams["MOTOR_FEEDBACK"]
    for side, other in (("left", "right"), ("right", "left")):
        assert np.abs(commanded[side]).max() <= top
        same = np.corrcoef(commanded[side], feedback[f"psi_{side}"])[0, 1]
        assert same > 0.7
        assert same > np.corrcoef(commanded[side], feedback[f"psi_{other}"])[0, 1]


def top_of(robot: Any) -> float:
    """Return the largest command that a robot takes: duty 1, or a wheel speed [rad/s]."""
    return float(robot.mapping.nominal.get("top_wheel_speed", 1.0))


def wheels_commanded(robot: Any) -> dict[str, Any]:
    """Return what was asked of each wheel: duties, or wheel speeds [rad/s]."""
    nominal, streams = robot.mapping.nominal, robot.streams
    if "MOTOR_COMMAND" in streams:
        return {side: streams["MOTOR_COMMAND"][side] for side in ("left", "right")}
    if "WHEEL_SPEED_COMMAND" in streams:
        return {side: streams["WHEEL_SPEED_COMMAND"][f"psi_{side}"] for side in ("left", "right")}
    body, half = streams["VELOCITY_COMMAND"], 0.5 * nominal["command_base_width"]
    return {
        side: (body["v"] + sign * half * body["omega"]) / nominal["wheel_radius"]
        for side, sign in (("left", -1.0), ("right", 1.0))
    }


@pytest.mark.parametrize(("name", "tolerance"), [("mbot", 0.05), ("maebot", 0.15)])
def test_gyro_turns_as_the_encoders_do(imported: Any, name: str, tolerance: float) -> None:
    # The MBot's gyro is biased by -0.27 deg/s (0.86 rad of 24), the MAEBot's scale is nominal.
    robot = imported(name)
    encoders = robot.encoder_heading()
    assert encoders[-1] > 10
    assert robot.gyro_heading()[-1] == pytest.approx(encoders[-1], rel=tolerance)


def test_gyro_turns_as_the_wheels_and_the_pose_do_in_each_window_of_the_tile(imported: Any) -> None:
    robot = imported("husky_tile")
    gyro, feedback = robot.streams["GYRO"]["yaw_rate"], robot.streams["MOTOR_FEEDBACK"]
    wheels = feedback["psi_right"] - feedback["psi_left"]
    assert np.corrcoef(gyro, wheels)[0, 1] > 0.9
    window = np.floor(robot.seconds("POSE") / 6.95).astype(int)  # 1.95 s and the gap of 5 s
    last = np.flatnonzero(np.diff(window, append=window[-1] + 1))
    heading = robot.gyro_heading()
    begin = np.searchsorted(robot.seconds("GYRO"), np.arange(600) * 6.95 - 0.01)
    end = np.searchsorted(robot.seconds("GYRO"), robot.seconds("POSE")[last] - 0.01)
    turned = heading[end] - heading[begin]
    assert len(last) == 600
    assert np.median(np.abs(turned - robot.streams["POSE"]["theta"][last])) < 0.05


@pytest.mark.parametrize(("name", "tolerance"), [("optiodom", 0.03), ("maebot", 0.10)])
def test_heading_of_the_encoders_is_that_of_the_pose(imported: Any, name: str, tolerance: float) -> None:
    robot = imported(name)
    pose, encoders = robot.pose_heading(), robot.encoder_heading()
    assert encoders[-1] - encoders[0] == pytest.approx(pose[-1] - pose[0], rel=tolerance)


@pytest.mark.parametrize(("name", "tolerance"), [("optiodom", 0.03), ("maebot", 0.10)])
def test_path_of_the_encoders_is_as_long_as_that_of_the_pose(imported: Any, name: str, tolerance: float) -> None:
    robot = imported(name)
    # In steps of half a second: the pose's noise would add to a path measured in small ones.
    seconds = robot.seconds("POSE")
    grid = np.arange(seconds[0], seconds[-1], 0.5)
    x, y = (np.interp(grid, seconds, robot.streams["POSE"][axis]) for axis in "xy")
    assert robot.encoder_path() == pytest.approx(np.hypot(np.diff(x), np.diff(y)).sum(), rel=tolerance)


def test_all_runs_of_optiodom_import_with_the_pose_turning_as_the_wheels(tmp_path: Path) -> None:
    runs = sorted(path.relative_to(DATA) for path in DATA.glob("optiodom/*/*.csv.gz"))
    if not runs:
        pytest.skip(f"measured data is not here: {DATA / 'optiodom'}")
    assert len(runs) == 38
    for run in runs:
        robot = Imported("optiodom", tmp_path, str(run))
        assert robot.encoder_heading()[-1] == pytest.approx(robot.pose_heading()[-1], rel=0.05), run
