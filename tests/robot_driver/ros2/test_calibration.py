"""A figure eight over the bridge is calibrated and diagnosed as one of a robot that is on the bus itself."""

from collections.abc import Mapping
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="the extra [ros] is not installed")

from cmr.calibration import calibrate
from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import NO_EFFECT
from cmr.recordings.recording import Recorder, Recording
from robot_driver.emulator.settings import Settings, load_settings
from tests.support import ros2_bench as bench
from tests.support.emulated_speed_robot import nominal_of

pytestmark = pytest.mark.slow

HIDDEN = """
velocity_controller: {response_time: 0.22, speed_scale: 0.96, top_wheel_speed: 16.0}
robot: {base_width: 0.24}
effects: {command_delay: 0.07, pose_offset: 0.03, gyro_bias: 0.01}
"""


def recorded(settings: Settings, known: Mapping[str, float] | None = None) -> Recording:
    """Return what is recorded of a figure eight, the robot's clock being 3.7 s ahead."""
    recorder = Recorder(0)
    for channel, message in bench.messages_of(settings, nominal_of(settings, **(known or {})), ahead=3.7):
        recorder.handle(message.utime, channel, message)
    return recorder.recording()


@pytest.mark.further  # on the bus: tests/robot_driver/emulator/test_speed_robot.py; a bag: test_replayed_bag.py
def test_calibration_finds_what_the_robot_hides(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(HIDDEN)
    settings = load_settings(path)
    known = {"base_width": 0.2, "response_time": 0.15}
    result = calibrate(recorded(settings, known), nominal_of(settings, **known))
    truth = {"response_time": 0.22, "speed_scale": 0.96, "base_width": 0.24}
    hidden = {"command_delay": 0.07, "pose_offset": 0.03, "gyro_bias": 0.01, "wheel_radius_asymmetry": 0.005}
    assert set(result.named) == set(hidden)
    found = {**result.reported, **result.effects}
    for name, value in {**truth, **hidden}.items():
        # What the bridge passes on at its next turn, 5 ms later, is a delay of the commands.
        late = 0.005 if name == "command_delay" else 0.0
        assert found[name].value == pytest.approx(value, abs=3.0 * found[name].std + late), name
        assert found[name].std < 0.1 * value, name


@pytest.mark.further  # as of a robot on the bus itself: tests/diagnosis/test_commanded_speeds.py
def test_a_robot_that_hides_nothing_has_nothing_found() -> None:
    settings = load_settings(ideal=True)
    found = diagnose(recorded(settings), nominal_of(settings))
    assert found.verdict == NO_EFFECT
    assert not found.unexplained.present
