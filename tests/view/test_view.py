"""What cmr-view shows, without a browser: from messages to the scene and the panels."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cmr.bus.messages import make
from cmr.bus.streams import (
    CALIBRATION_STATUS,
    MOTOR_FEEDBACK,
    PARAMETERS,
    PROCESS_STATUS,
    RANGE_SCAN,
    WORLD_STATE,
)
from cmr.msg import (
    gyro_t,
    motor_feedback_t,
    pose_xyt_t,
    range_scan_t,
    robot_state_t,
    velocity_command_t,
    waypoints_t,
)
from cmr.parameters.file import ParameterFile, Value
from cmr.view import shapes, words
from cmr.view.camera import INITIAL, TOP, Camera, overview
from cmr.view.charts import distances, estimates, ticks
from cmr.view.data.log_index import Mark
from cmr.view.data.robots import REAL, TWIN, VIRTUAL
from cmr.view.data.state import ViewState
from cmr.view.drawing import bar, paths_drawing
from cmr.view.look import PANEL_SHARE, legend, page_look, time_bar
from cmr.view.picture import BLUE, GREY, YELLOW, Bodies, picture_of, rays, trails
from cmr.view.showing import crowd
from cmr.view.stage import MANY, Instances
from tests.support.small_log import FIELDS
from tests.support.view_states import NOW, SECOND, pass_time, showing, status, take_message, three, world

# The scene


def test_real_robots_are_yellow_virtual_ones_blue_and_twins_are_ghosts() -> None:
    picture = picture_of(showing(three(NOW)))
    assert picture.solid_ids.tolist() == [0, 27]
    assert picture.solid.colour.tolist() == [list(YELLOW), list(BLUE)]
    assert picture.ghosts.position.tolist() == [pytest.approx([0.03, 0.0, 0.0])]
    assert picture.solid.wxyz[1] == pytest.approx([0.0, 0.0, 0.0, 1.0], abs=1e-12)


def test_the_parts_of_a_world_are_put_together_and_who_is_told_of_no_more_goes() -> None:
    state = showing(world(NOW, [(1, VIRTUAL, 0.0, 0.0, 0.0)]), world(NOW, [(2, VIRTUAL, 5.0, 0.0, 0.0)]))
    assert picture_of(state).solid_ids.tolist() == [1, 2]
    pass_time(state, NOW + 6 * SECOND, world(NOW + 6 * SECOND, [(2, VIRTUAL, 6.0, 0.0, 0.0)]))
    assert picture_of(state).solid_ids.tolist() == [2]


def test_a_robot_that_is_silent_is_greyed_then_gone_from_everything_and_back_when_it_comes_back() -> None:
    only_27 = [world(NOW + k * SECOND, [(27, VIRTUAL, 1.0, 0.0, 0.0)]) for k in range(7)]
    state = showing(three(NOW))
    take_message(state, NOW, "GYRO_0", make(gyro_t, utime=NOW, robot_id=0, **FIELDS["GYRO"]))
    state.handle(NOW, "WAYPOINTS_0", make(waypoints_t, utime=NOW, robot_id=0, x=[0.0, 1.0], y=[0.0, 0.0]))
    pass_time(state, NOW + 2 * SECOND, *only_27[:3])
    assert picture_of(state).solid.colour.tolist() == [list(GREY), list(BLUE)]
    assert picture_of(state).ghosts.colour.tolist() == [list(GREY)]
    assert crowd(state) == "1 real, 1 virtual, 1 twin (2 silent)"
    assert "silent robot" in legend(state, False)
    assert "silent at the moment" in words.robot(state, 0)
    assert "GYRO_0" in state.heard_channels()
    assert list(state.divergence) == [0]
    pass_time(state, NOW + 6 * SECOND, *only_27[3:])
    picture = picture_of(state)
    assert (picture.solid_ids.tolist(), len(picture.ghosts.position), len(picture.waypoints.ends)) == ([27], 0, 0)
    assert all(name not in legend(state, False) for name in ("real", "twin", "silent", "way"))
    assert "virtual robot" in legend(state, False)
    assert state.divergence == {}
    assert "not in the world" in words.robot(state, 0)
    assert "GYRO_0" not in state.heard_channels()
    pass_time(state, NOW + 70 * SECOND)
    assert "gyro" not in words.robot(state, 0)
    pass_time(state, NOW + 70 * SECOND, three(NOW + 70 * SECOND))
    assert picture_of(state).solid.colour.tolist() == [list(YELLOW), list(BLUE)]
    assert "GYRO_0" in state.heard_channels()


def test_a_robot_is_where_the_best_source_says() -> None:
    state = showing(three(NOW))
    pose = make(pose_xyt_t, utime=NOW, robot_id=0, x=9.0, y=9.0, theta=0.0)
    fields = dict.fromkeys(("psi_left", "psi_right", "domega_left", "domega_right", "y", "theta"), 0.0)
    state.handle(NOW + 1, "POSE_0", pose)
    assert state.present().place(0) == (0.0, 0.0, 0.0), "WORLD_STATE knows better than a measured pose"
    state.handle(NOW + SECOND, "POSE_0", pose)
    state.advance(NOW + SECOND)
    assert state.present().place(0) == (9.0, 9.0, 0.0), "of a robot without a simulator the pose is shown"
    estimate = make(robot_state_t, utime=NOW + SECOND, robot_id=0, origin=REAL, x=4.0, **fields)
    state.handle(NOW + SECOND, "ROBOT_STATE_0", estimate)
    state.handle(NOW + SECOND, "POSE_0", pose)
    assert state.present().place(0) == (4.0, 0.0, 0.0)


def test_robots_without_a_place_are_not_drawn() -> None:
    assert len(picture_of(showing(world(NOW, [(1, REAL, np.nan, 0.0, 0.0)]))).solid_ids) == 0


def test_every_robot_but_twins_carries_the_digits_of_its_id() -> None:
    placed = picture_of(showing(world(NOW, [(0, REAL, 0, 0, 0), (0, TWIN, 0, 0, 0), (907, VIRTUAL, 2, 3, 1)]))).digits
    counts = {value: len(places) for value, places in enumerate(placed) if len(places)}
    assert counts == {0: 2, 7: 1, 9: 1}
    nine, nought, seven = placed[9][0], placed[0][-1], placed[7][0]
    assert nine[0] < nought[0] < seven[0], "they are read from left to right"
    assert nought[:2] == pytest.approx([2.0, 3.0])


def test_trails_last_as_long_as_wished_and_do_not_follow_jumps() -> None:
    moments = [three(NOW + k * SECOND // 4, 0.1 * k) for k in range(40)]
    state = showing(*moments)
    assert len(trails(state.trails.shown(state.now, 5.0)).ends) == 3 * 21
    assert len(trails(state.trails.shown(state.now, 0.5)).ends) == 3 * 3
    before = len(state.trails.shown(state.now, 60.0).origin)
    jumped = three(moments[-1].utime + SECOND // 4, 50.0)
    state.handle(jumped.utime, WORLD_STATE.name, jumped)
    state.advance(jumped.utime)
    assert len(state.trails.shown(state.now, 60.0).origin) == before


def test_waypoints_are_lines_with_a_mark_at_the_end_and_nonsense_is_left_out() -> None:
    state = showing(three(NOW))
    x = [0.0, 1.0, float("nan"), 2.0]
    state.handle(NOW, "WAYPOINTS_0", make(waypoints_t, utime=NOW, robot_id=0, x=x, y=[0.0] * 4))
    ends = picture_of(state).waypoints.ends
    assert np.isfinite(ends).all()
    assert ends[0, :, 0].tolist() == [0.0, 1.0]
    assert ends[2:, :, 0].mean() == pytest.approx(2.0)


def test_rays_end_where_the_sensor_saw_something() -> None:
    state = showing(world(NOW, [(3, REAL, 1.0, 1.0, np.pi / 2)]))
    scan = make(
        range_scan_t, utime=NOW, robot_id=3, angle_first=0.0, angle_step=np.pi / 2, range_max=5.0, ranges=[2.0, np.inf]
    )
    state.handle(NOW, RANGE_SCAN.channel(3), scan)
    assert rays(state, 3).ends[:, :, :2].tolist() == [[[1.0, 1.0], pytest.approx([1.0, 3.0])]]
    assert len(rays(state, 4).ends) == 0


def test_shapes_are_closed_and_point_ahead() -> None:
    vertices, faces = shapes.robot()
    assert vertices[vertices[:, 0].argmax(), 1] == 0.0, "its nose is in the middle"
    corners = np.unique(vertices.round(9), axis=0, return_inverse=True)[1].reshape(-1)[faces]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]).tolist()
    assert all([b, a] in edges for a, b in edges), "every edge has a face on both sides"


def test_thousands_of_robots_are_drawn_plainly() -> None:
    made: list[Any] = []
    scene: Any = SimpleNamespace(add_batched_meshes_simple=lambda *mesh, **_look: made.append(mesh))
    for count in (3, MANY + 1):
        x, colours = np.zeros((count, 3)), np.zeros((count, 3), np.uint8)
        Instances(scene, "/robots", shapes.robot(), shapes.plain_robot()).show(Bodies(x, np.zeros((count, 4)), colours))
    few, many = (len(faces) for _name, _vertices, faces, *_ in made)
    assert many < few / 10


def test_a_camera_above_has_all_robots_in_its_picture() -> None:
    robots = showing(world(NOW, [(1, VIRTUAL, -40.0, 2.0, 0.0), (2, VIRTUAL, 60.0, 4.0, 0.0)])).present()
    (x, _, height), target = overview(robots, field_of_view=np.pi / 2, aspect=1.0)
    assert (x, target) == (10.0, (10.0, 3.0, 0.0))
    assert height > 50.0
    assert overview(ViewState().present())[0][2] > 0.0, "also where nobody is"


def test_on_a_phone_no_robot_is_behind_the_panel() -> None:
    robots = showing(world(NOW, [(1, VIRTUAL, 0.0, -2.0, 0.0), (2, VIRTUAL, 1.0, 4.0, 0.0)])).present()
    (x, _, height), (_, y, _) = overview(robots, field_of_view=np.pi / 2, aspect=390 / 844)
    # With this field of view the picture's upper and lower ends are as far away as the camera is high.
    assert y + height > 4.0
    assert y - height + 2.0 * height * PANEL_SHARE < -2.0
    assert abs(x - 0.5) + 0.5 < height * 390 / 844


class FakeCamera:
    """A visitor's camera as viser has it."""

    fov, aspect = 0.75, 1.5

    def __init__(self) -> None:
        self.position, self.look_at = np.zeros(3), np.zeros(3)


@pytest.mark.parametrize("touched", [False, True])
def test_a_camera_above_keeps_robots_in_its_picture_until_the_visitor_looks_elsewhere(touched: bool) -> None:
    fake = FakeCamera()
    camera = Camera(SimpleNamespace(camera=fake))  # type: ignore[arg-type]
    camera.choose(TOP, showing(three(NOW)).present())
    put = fake.position = np.array(fake.position) + (0.5 if touched else 0.001)
    camera.advance(showing(three(NOW, 0.5)).present(), 0)
    assert fake.position is put, "a robot that goes a little further is still in the picture"
    camera.advance(showing(three(NOW, 20.0)).present(), 0)
    assert (fake.position is put) == touched
    assert touched or fake.position[0] == pytest.approx(10.515)


def test_a_browser_too_slow_to_hear_where_its_camera_was_put_is_told_again() -> None:
    fake = FakeCamera()
    camera = Camera(SimpleNamespace(camera=fake))  # type: ignore[arg-type]
    camera.choose(TOP, showing(three(NOW, 20.0)).present())
    fake.position = np.array(INITIAL)
    camera.advance(showing(three(NOW, 20.0)).present(), 0)
    assert fake.position[0] == pytest.approx(10.515)


# Panels


def test_status_bits_are_told_in_words() -> None:
    assert words.status_words(0) == "healthy"
    told = words.status_words(motor_feedback_t.STATUS_ESTOP | motor_feedback_t.STATUS_BATTERY | 1 << 20)
    assert told == "the emergency stop is engaged; the battery is low or unknown; unknown status 0x100000"


def test_what_a_stranger_says_is_no_html() -> None:
    state = showing(three(NOW))
    state.handle(NOW, PROCESS_STATUS.name, status("<script>alert(1)</script>", "<img src=x onerror=alert(2)>"))
    state.traffic.take(NOW, "<b>", b" ")
    for panel in (words.processes(state), words.bus(state), words.sentence("<b>")):
        assert not any(tag in panel for tag in ("<script", "<img", "<b>"))


def test_what_goes_to_browsers_are_plain_texts() -> None:
    """Viser's encoder takes no class made of `str`."""
    state = showing(three(NOW))
    marks = [(1.0, Mark(NOW, "stop", "smoke"))]
    texts = [words.robot(state, 0), words.sentence("a"), legend(state, True), page_look(), time_bar(1.0, 2.0, marks)]
    texts += [bar(0.5), paths_drawing([("a", None)]), words.drives(state, 0), words.processes(state)]
    assert {type(text) for text in texts} == {str}


def test_a_process_that_says_nothing_is_told_to_be_silent_and_then_forgotten() -> None:
    state = ViewState()
    state.handle(NOW, PROCESS_STATUS.name, status("cmr-sim", ""))
    state.now = NOW + 5 * SECOND
    assert "silent for 5 s" in words.processes(state)
    state.advance(NOW + 61 * SECOND)
    assert not state.processes


def test_a_robot_is_told_with_what_its_driver_says() -> None:
    state = showing(three(NOW))
    values = {**FIELDS["MOTOR_FEEDBACK"], "status": motor_feedback_t.STATUS_NOT_ARMED}
    state.handle(NOW, MOTOR_FEEDBACK.channel(0), make(motor_feedback_t, utime=NOW, robot_id=0, **values))
    panel = words.robot(state, 0)
    assert all(told in panel for told in ("12.1 V", "? °C", "not armed", "twin"))
    assert "not in the world" in words.robot(state, 99)
    assert "ago" not in panel
    state.advance(NOW + 12 * SECOND)
    assert "says nothing any more; this was 12 s ago" in words.robot(state, 0)


def test_a_robots_parameters_are_told_with_their_values() -> None:
    state = showing(three(NOW))
    known = ParameterFile(0, {"wheel_radius": Value(0.04), "base_width": Value(0.16)}).announcement(5)
    state.handle(NOW, PARAMETERS.channel(0), known)
    assert "wheel_radius 0.04 m, base_width 0.16 m" in words.robot(state, 0)
    assert words.parameter_values("no: file") == ""


def test_calibration_has_intervals_and_twins_have_the_sentence_of_the_diagnosis() -> None:
    state = showing(*(three(NOW + k * SECOND) for k in range(3)))
    for k, std in enumerate((4.0, 1.0)):
        values = {**FIELDS["CALIBRATION_STATUS"], "k2_over_k3": 118.0, "k2_over_k3_std": std}
        message = make(CALIBRATION_STATUS.message_type, utime=NOW + k * SECOND, robot_id=0, **values)
        state.handle(message.utime, CALIBRATION_STATUS.channel(0), message)
    seconds, value, high, low = estimates(state.calibrations[0])["k2_over_k3"]
    assert seconds.tolist() == [0.0, 1.0]
    assert (high - value).tolist() == pytest.approx([7.84, 1.96])
    assert (value - low).tolist() == pytest.approx([7.84, 1.96])
    told = words.calibration(state.calibrations[0][-1].message)
    assert "118 ± 2 rad/s² (95 %)" in told
    assert "simulated path 50.0 cm off (rms)" in told
    nothing = dict.fromkeys(("k1", "k1_std", "base_width", "base_width_std"), np.nan)
    unknown = make(CALIBRATION_STATUS.message_type, utime=NOW, robot_id=0, **{**values, **nothing})
    assert words.calibration(unknown).count("not known") == 3
    state.handle(NOW, PROCESS_STATUS.name, status("cmr-diagnose", "Robot 0: its left motor is weaker."))
    assert "its left motor is weaker" in words.twins(state)
    assert "3.0 cm" in words.twins(state)
    assert distances(state.divergence[0], state.now)[1] == pytest.approx([3.0, 3.0, 3.0])


def test_a_robot_with_a_velocity_controller_is_shown_with_its_commands_and_in_its_own_words() -> None:
    file = ParameterFile(
        0,
        {
            "wheel_radius": Value(0.04),
            "base_width": Value(0.2),
            "response_time": Value(0.25),
            "top_wheel_speed": Value(20.0),
        },
    )
    state = showing(three(NOW))
    command = make(velocity_command_t, utime=NOW, robot_id=0, v=0.25, omega=-0.5)
    # What 0.2 s and 0.9 of the commanded speed come to: k1 = 1 / (0.9 * 20), k2 = 0.9 * 20 / 0.2.
    fields = {**FIELDS["CALIBRATION_STATUS"], "k1": 1.0 / 18.0, "k2_over_k3": 90.0, "robot_id": 0, "utime": NOW}
    for channel, message in (
        ("PARAMETERS_0", file.announcement(1)),
        ("VELOCITY_COMMAND_0", command),
        ("CALIBRATION_STATUS_0", make(CALIBRATION_STATUS.message_type, **fields)),
    ):
        state.handle(NOW, channel, message)
    told = words.robot(state, 0)
    assert "+0.25 m/s, turning -0.50 rad/s" in told
    assert "response_time 0.25 s" in told
    controller = words.controller_of(state, 0)
    told = words.calibration(state.calibrations[0][-1].message, controller)
    assert "0.2 ±" in told
    assert "0.9 ±" in told
    assert "k1" not in told
    columns = estimates(state.calibrations[0], controller)
    assert columns["response_time"][1].tolist() == pytest.approx([0.2])
    assert columns["k1"].shape == (4, 0)


@pytest.mark.parametrize(
    ("low", "high", "texts"),
    [
        (0.05421, 0.05479, ("0.0543", "0.0544", "0.0545", "0.0546", "0.0547")),
        (-8.0, 330.0, ("0", "100", "200", "300")),
        (117.1, 117.9, ("117.2", "117.4", "117.6", "117.8")),
    ],
)
def test_numbers_beside_a_chart_can_be_told_apart(low: float, high: float, texts: tuple[str, ...]) -> None:
    numbers, written = ticks(low, high)
    assert written == texts
    assert numbers == pytest.approx([float(text) for text in texts])
