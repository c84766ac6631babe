"""What cmr-spy shows, what its keys do, and that it hears a bus."""

import curses
import os
import re
import select
import subprocess
import sys
import time
from pathlib import Path

import lcm
import pytest

from cmr.bus.messages import Received, decode, make
from cmr.cli.errors import CommandError
from cmr.msg import motor_feedback_t, pose_xyt_t, process_status_t, waypoints_t
from cmr_tools.spy import main as spy
from cmr_tools.spy.statistics import Statistics
from cmr_tools.spy.view import ESCAPE, View, details, document, table
from tests.support.documented_keys import documented

pytestmark = pytest.mark.waits

PATIENCE = 60.0  # s; of a machine with much else to do
NOW = 1_700_000_000_000_000  # us
FEEDBACK = make(
    motor_feedback_t, **{name: 0 for name in motor_feedback_t.__slots__ if name != "utime"}, utime=NOW - 12_500
)
STATUS = make(
    process_status_t,
    **{"utime": NOW, "process": "cmr-sim", "host": "h", "pid": 1, "state": 1, "parameters_sha256": ""},
    loop_rate_hz=100.0,
    loop_overruns=0.0,
    message="all\nis \x1b[31mwell",
)


def pose(robot_id: int, x: float = 1.25) -> bytes:
    return bytes(make(pose_xyt_t, utime=NOW, robot_id=robot_id, x=x, y=-2.0, theta=0.0).encode())


def bus_of_three() -> Statistics:
    """Two poses, a motor feedback and a status, all heard at NOW."""
    statistics = Statistics()
    for robot_id in (0, 12):
        statistics.handle(NOW, f"POSE_{robot_id}", pose(robot_id))
    statistics.handle(NOW, "MOTOR_FEEDBACK_0", FEEDBACK.encode())
    statistics.handle(NOW, "PROCESS_STATUS", STATUS.encode())
    return statistics


def view() -> View:
    statistics = bus_of_three()
    return View(lambda: statistics.lines(NOW))


def shown(view: View, height: int = 20, width: int = 200) -> str:
    return "\n".join(row.text for row in view.screen(height, width))


def press(view: View, *keys: str) -> None:
    for key in keys:
        view.press(key)


def test_the_table_has_a_line_for_each_channel_with_its_last_values() -> None:
    lines = table(bus_of_three().lines(NOW), lambda _channel: True)
    assert [line.split()[:2] for line in lines[1:]] == [
        ["MOTOR_FEEDBACK_0", "motor_feedback_t"],
        ["POSE_0", "pose_xyt_t"],
        ["POSE_12", "pose_xyt_t"],
        ["PROCESS_STATUS", "process_status_t"],
    ]
    assert lines[2].endswith("x=1.25 y=-2 theta=0")


def test_programs_read_each_channel_with_all_fields_of_its_last_message() -> None:
    statistics = bus_of_three()
    statistics.handle(NOW, "FOREIGN", bytes(100))
    channels = document(NOW, statistics.lines(NOW), lambda _channel: True)["channels"]
    assert all(set(channel) == documented("cmr spy")[0] for channel in channels.values())
    assert channels["POSE_12"]["last"] == {"utime": NOW, "robot_id": 12, "x": 1.25, "y": -2.0, "theta": 0.0}
    assert channels["FOREIGN"]["last"] is None


def test_what_a_stranger_sends_cannot_upset_the_terminal() -> None:
    statistics = bus_of_three()
    statistics.handle(NOW, "EVIL\x1b[2J\n", b"")
    text = "\n".join(table(statistics.lines(NOW), lambda _channel: True))
    assert "\x1b" not in text
    assert len(text.splitlines()) == 6


def test_damage_and_foreign_messages_are_told_in_place_of_values() -> None:
    statistics = Statistics()
    statistics.handle(NOW, "POSE_0", pose(0)[:-1])
    statistics.handle(NOW, "CAMERA", bytes(100))
    camera, damaged = table(statistics.lines(NOW), lambda _channel: True)[1:]
    assert camera.endswith("100 bytes")
    assert "corrupt: POSE_0" in damaged


def test_details_have_every_field_with_its_unit_and_the_delay() -> None:
    feedback = next(line for line in bus_of_three().lines(NOW) if line.channel == "MOTOR_FEEDBACK_0")
    text = "\n".join(details(feedback))
    assert all(name in text for name in motor_feedback_t.__slots__)
    assert re.search(r"psi_left \[rad/s\] +0\n", text)
    assert "stamped 12.5 ms before it arrived" in text
    recorded = "\n".join(details(feedback._replace(utime=feedback.utime + 5 * 3600 * 10**6)))
    assert "stamped 5.0 h before it arrived: recorded at another time" in recorded


def test_arrays_are_shown_in_short_in_the_table_and_longer_in_detail() -> None:
    statistics = Statistics()
    numbers = [float(number) for number in range(9)]
    statistics.handle(NOW, "WAYPOINTS_0", make(waypoints_t, utime=NOW, robot_id=0, x=numbers, y=numbers).encode())
    lines = statistics.lines(NOW)
    assert "n=9 x=[0 1 2 3 ...] y=[0 1 2 3 ...]" in table(lines, lambda _channel: True)[1]
    assert "[0 1 2 3 4 5 6 7 8]" in "\n".join(details(lines[0]))


def test_a_filter_is_typed_corrected_kept_and_taken_away() -> None:
    spying = view()
    press(spying, "/", "p", "o", "x", "\x7f", "s")
    assert "filter: pos_" in shown(spying)
    press(spying, "\n")
    assert "PROCESS_STATUS" not in shown(spying)
    assert "POSE_12" in shown(spying)
    press(spying, "/", "q", ESCAPE)
    assert "PROCESS_STATUS" in shown(spying)
    assert not spying.quit, "a letter of the filter is no command"


def test_a_frozen_screen_stays_as_it_is() -> None:
    statistics = bus_of_three()
    spying = View(lambda: statistics.lines(NOW))
    press(spying, " ")
    before = shown(spying)
    assert "FROZEN" in before
    statistics.handle(NOW, "POSE_0", pose(0, x=7.0))
    assert shown(spying) == before
    press(spying, " ")
    assert "x=7 " in shown(spying)


def test_a_channel_is_chosen_and_opened_and_closed() -> None:
    spying = view()
    press(spying, "down", "down", "\n")
    assert "MOTOR_FEEDBACK_0" not in shown(spying)
    assert re.search(r"x \[m\] +1.25", shown(spying))
    press(spying, ESCAPE, "down", "down", "down", "up")
    assert [row.text.split()[0] for row in spying.screen(20, 80) if row.chosen] == ["POSE_12"]


def test_the_chosen_channel_stays_on_a_small_screen() -> None:
    statistics = Statistics()
    for robot_id in range(50):
        statistics.handle(NOW, f"POSE_{robot_id}", pose(robot_id))
    spying = View(lambda: statistics.lines(NOW))
    for _ in range(50):
        spying.press("down")
        rows = spying.screen(8, 40)
        assert len(rows) == 8
        assert sum(row.chosen for row in rows) == 1
    assert all(len(row.text) <= 40 for row in rows)


@pytest.mark.parametrize("height", range(5))
def test_the_smallest_screens_do_no_harm(height: int) -> None:
    assert len(view().screen(height, 3)) == height


def test_only_what_is_shown_is_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    decoded: list[str] = []

    def decode_and_note(channel: str, data: bytes) -> Received:
        decoded.append(channel)
        return decode(channel, data)

    monkeypatch.setattr("cmr_tools.spy.view.decode", decode_and_note)
    statistics = Statistics()
    for robot_id in range(50):
        statistics.handle(NOW, f"POSE_{robot_id}", pose(robot_id))
    View(lambda: statistics.lines(NOW)).screen(10, 80)
    assert decoded == [f"POSE_{robot_id}" for robot_id in (0, 1, 10, 11, 12, 13, 14)]


# On a bus


def test_without_a_terminal_the_table_is_printed_once(url: str) -> None:
    command = [str(Path(sys.executable).parent / "cmr-spy"), "--lcm-url", url, "--once", "1", "--channel", "POSE_*"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    bus = lcm.LCM(url)
    while process.poll() is None:
        for channel in ("POSE_0", "GYRO_0"):
            bus.publish(channel, pose(0))
        time.sleep(0.02)
    said, _ = process.communicate()
    assert process.returncode == 0
    [head, row] = said.splitlines()
    assert head.startswith("CHANNEL ")
    assert re.match(r"POSE_0 +pose_xyt_t +\d+\.\d .* 0  x=1\.25 y=-2 theta=0$", row)


def test_a_screen_is_drawn_and_a_key_ends_it(url: str) -> None:
    person, program = os.openpty()
    environment = {**os.environ, "TERM": "xterm", "LINES": "24", "COLUMNS": "100"}
    command = [str(Path(sys.executable).parent / "cmr-spy"), "--lcm-url", url]
    process = subprocess.Popen(command, stdin=program, stdout=program, env=environment)
    try:
        drawn = ""
        while "q: quit" not in drawn and select.select([person], [], [], PATIENCE)[0]:
            drawn += os.read(person, 10_000).decode()
        os.write(person, b"q")
        assert process.wait(PATIENCE) == 0
    finally:
        process.kill()
        process.wait()
        os.close(program)
        os.close(person)
    assert "CHANNEL" in drawn
    assert "q: quit" in drawn


def test_a_terminal_that_nobody_knows_is_told_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_work: object) -> None:
        raise curses.error("setupterm: could not find terminal")

    monkeypatch.setattr(curses, "wrapper", fail)
    with pytest.raises(CommandError, match=r"could not find terminal.*--once"):
        spy._on_terminal(lambda _window: None)
