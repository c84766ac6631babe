"""From the bytes of the bus to what cmr-view shows: what counts of each channel, and how much is said there."""

from typing import Any

import pytest

from cmr.bus.messages import make
from cmr.bus.streams import CAMERA_IMAGE, PROCESS_STATUS
from cmr.msg import gyro_t
from cmr.view.camera_panel import caption
from cmr.view.data.intake import Intake
from cmr.view.data.state import ViewState
from tests.support.small_log import FIELDS, small_log
from tests.support.view_states import NOW, SECOND, status, three


def test_of_each_robot_the_last_message_counts_and_every_process() -> None:
    state = ViewState()
    intake = Intake(state)
    for event in small_log():
        intake.take(event.utime, event.channel, event.data)
    intake.take(NOW, PROCESS_STATUS.name, status("cmr-driver", "").encode())
    intake.take(NOW, "POSE_3", b"nonsense")
    intake.take(NOW, "SOMETHING_ELSE", b"of somebody else")
    intake.flush()
    assert {name for name, _, _ in state.processes} == {"cmr-sim", "cmr-driver"}
    assert state.estop.engaged
    rejected = {line.channel: line.errors for line in state.traffic.lines(NOW)}
    assert (rejected["POSE_3"], rejected["SOMETHING_ELSE"], rejected["GYRO_3"]) == (1, 1, 0)


@pytest.mark.parametrize("turn", [1, 50_000])
def test_rates_age_and_gaps_of_a_channel_that_is_listened_to_now_and_then(turn: int) -> None:
    state = ViewState()
    moments = [NOW + 10_000 * k for k in range(300) if k not in (150, 151, 152)]
    for moment in moments:
        reading = make(gyro_t, utime=moment, robot_id=0, **FIELDS["GYRO"]).encode()
        state.traffic.take(moment // turn * turn, "GYRO_0", reading)
    [line] = state.traffic.lines(moments[-1] + SECOND // 2)
    assert line.gaps == 1
    assert line.age == pytest.approx(0.5, abs=0.06)
    assert line.rate == pytest.approx(297 / 3.5, rel=0.1)
    assert line.bytes_per_second == pytest.approx(len(reading) * line.rate)


def test_stamps_that_came_in_a_bunch_make_no_gaps_of_what_follows() -> None:
    state = ViewState()
    moments = [NOW + 10_000 * k for k in range(500)]
    moments[200:300] = [moments[300] - 100 + k for k in range(100)]  # a second late, all at once
    for moment in moments:
        state.traffic.take(moment, "GYRO_0", make(gyro_t, utime=moment, robot_id=0, **FIELDS["GYRO"]).encode())
    assert [line.gaps for line in state.traffic.lines(moments[-1])] == [1]


def test_parts_of_a_world_are_no_gaps_and_what_comes_at_no_certain_times_has_none() -> None:
    state = ViewState()
    for k in range(100):
        for _part in range(5):
            utime = NOW + 20_000 * k
            state.traffic.take(utime, "WORLD_STATE", three(utime).encode())
        state.traffic.take(NOW + 1000 * k**2, "PROCESS_STATUS", status("cmr-sim", "").encode())
        state.traffic.take(NOW + 1000 * k**2, "STRANGE", b"")
    assert {line.channel: line.gaps for line in state.traffic.lines(NOW)} == {
        **{"WORLD_STATE": 0, "PROCESS_STATUS": None, "STRANGE": None}
    }


def camera_image(utime: int, camera: str) -> Any:
    return make(CAMERA_IMAGE.message_type, utime=utime, **{**FIELDS["CAMERA_IMAGE"], "camera": camera})


def test_of_each_camera_the_last_picture_counts_until_it_is_old() -> None:
    state = ViewState()
    intake = Intake(state)
    for k, camera in enumerate(("door", "window", "door")):
        intake.take(NOW + k, CAMERA_IMAGE.name, camera_image(NOW + k, camera).encode())
    intake.flush()
    assert {name: heard.utime for name, heard in state.cameras.items()} == {"door": NOW + 2, "window": NOW + 1}
    assert caption(state.cameras["door"], NOW + SECOND) == "door, 2 x 1"
    assert caption(state.cameras["door"], NOW + 9 * SECOND) == "door, 2 x 1, no picture for 9 s"
    state.advance(NOW + 61 * SECOND)
    assert not state.cameras
