"""cmr-camera tells poses and pictures on the bus, reads what it is given, and says in a sentence what is wrong."""

import itertools
import math
import re
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cmr.bus.bus import Bus
from cmr.bus.streams import CAMERA_IMAGE, POSE, PROCESS_STATUS, WORLD_STATE
from cmr.camera import sources, watching
from cmr.camera.floor import Floor
from cmr.camera.lens import CameraFileError, Lens
from cmr.camera.sources import Film, SourceError, Taken, Video
from cmr.camera.watcher import Watcher
from cmr.camera.watching import Latency, Watching
from cmr.cli.errors import CommandError
from cmr.commands.camera import main
from cmr.model.motion import RobotState
from cmr.world.view import VIRTUAL, Robot, world_messages
from tests.support.bus_bench import PATIENCE, our_command
from tests.support.camera_bench import contents, floor_file, floor_of, lens_of, squares_of
from tests.support.rendered_floor import FLOOR_TAGS, Box, Eye, Scene
from tests.support.typed_messages import all_of

SMALL = Eye(width=640, height=360, focal=460.0, centre=(324.0, 177.0))
EPOCH = 1_700_000_000_000_000  # us


@pytest.mark.waits
def test_poses_and_pictures_with_virtual_robots_are_told_on_the_bus(url: str, tmp_path: Path) -> None:
    room, robot = Scene(SMALL, FLOOR_TAGS), Box(0.3, 0.1, 1.0, 0)
    (tmp_path / "pictures").mkdir()
    for k in range(12):
        cv2.imwrite(str(tmp_path / "pictures" / f"{EPOCH + 100_000 * k}.png"), room.picture([robot]))
    lens_of(SMALL).save(tmp_path / "lens.yaml")
    bus = Bus(url)
    for stream in (POSE, CAMERA_IMAGE, PROCESS_STATUS):
        bus.subscribe(stream, every=True)
    command = [our_command("cmr-camera"), "--lcm-url", url, str(tmp_path / "pictures"), "--record", "run.mkv"]
    command += ["--floor", str(floor_file(tmp_path)), "--name", "ceiling"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    virtual = Robot(EPOCH + 500_000, 10, VIRTUAL, RobotState.at_rest(-0.4, 0.1))
    received, deadline = [], time.monotonic() + PATIENCE
    while process.poll() is None:
        assert time.monotonic() < deadline
        for message in world_messages(EPOCH + 500_000, [virtual]):
            bus.publish(WORLD_STATE, message)
        received += bus.receive(0.02)
    assert (process.returncode, process.communicate()[0]) == (0, "12 pictures: robot 0 in 12.\n")
    poses = all_of(POSE, received)
    images = all_of(CAMERA_IMAGE, received)
    assert [pose.utime for pose in poses] == [EPOCH + 100_000 * k for k in range(12)]
    for pose in poses:
        assert math.hypot(pose.x - robot.x, pose.y - robot.y) < 0.005
    assert [(image.camera, image.width, image.height) for image in images] == [("ceiling", 640, 360)] * 12
    last = cv2.imdecode(np.frombuffer(images[-1].jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert last is not None
    ((u, v),) = np.round(SMALL.pixels(np.array([(-0.4, 0.1, 0.1)]))).astype(int)
    blue, _, red = last[v - 4 : v + 5, u - 12 : u + 13].reshape(-1, 3).mean(axis=0)
    assert blue > red + 60
    assert len(frames(tmp_path / "run.mkv")) == 12


def frames(path: Path) -> list[Taken]:
    film = Film(path, 30.0, hurry=True)
    return list(itertools.takewhile(lambda taken: taken is not None, iter(film.read, None)))


# What is printed


@pytest.mark.slow
def test_the_board_is_printed_in_its_true_size(tmp_path: Path) -> None:
    assert main(["board", "--out", str(tmp_path / "board.pdf")]) == 0
    paper, squares = squares_of(tmp_path / "board.pdf")
    assert paper == pytest.approx((0.297, 0.210), abs=1e-5)
    assert squares[:, 1].max(axis=0) - squares[:, 0].min(axis=0) == pytest.approx((7 * 0.036, 5 * 0.036), abs=1e-5)


def test_tags_are_printed_in_the_size_that_was_asked_for(tmp_path: Path) -> None:
    assert main(["tags", "0-1,7", "--size", "0.12", "--out", str(tmp_path / "tags.pdf")]) == 0
    _, squares = squares_of(tmp_path / "tags.pdf")
    assert squares[:, 1].max(axis=0) - squares[:, 0].min(axis=0) == pytest.approx((0.12, 0.12), abs=1e-5)
    assert (tmp_path / "tags.pdf").read_bytes().count(b"/Type /Page ") == 3
    assert b"0 1 -1 0" not in contents(tmp_path / "tags.pdf"), "who can read the words holds the tag upright"
    assert main(["tags", "0", "--size", "0.164", "--out", str(tmp_path / "tags.pdf")]) == 0
    with pytest.raises(CommandError, match=r"does not fit a4 with white around it: 0\.164 m at most"):
        main(["tags", "0", "--size", "0.2", "--out", str(tmp_path / "tags.pdf")])


# What is wrong is told


@pytest.mark.parametrize(
    ("more", "wrong"),
    [
        ("  10: {x: 0}", r"tags \[10\] are both on the floor and on a robot"),
        ("  3: {hight: 0.1}", "robots: 3: unknown: hight; known: size, height"),
        ("  600: {}", "600 is no tag of 36h11"),
        ("  3: {size: 0}", "size is a length of more than 0 m"),
        ("rooms: 1", "unknown: rooms"),
    ],
)
def test_a_floor_file_that_cannot_be_is_refused(more: str, wrong: str, tmp_path: Path) -> None:
    with pytest.raises(CameraFileError, match=rf"floor.yaml: line \d+: {wrong}"):
        Floor.load(floor_file(tmp_path, more=more))


def test_a_floor_file_is_read_as_written(tmp_path: Path) -> None:
    floor = Floor.load(floor_file(tmp_path, more="  7: {x: 0.02, theta: 1.5, robot_id: 3}\n  only: [0, 1]\n"))
    assert floor.tags == floor_of().tags
    assert [floor.robot_id(number) for number in (0, 1, 2, 7, 10)] == [0, 1, None, 3, None]
    assert floor.number(3) == 7
    carried = floor.robot_tag(7)
    assert (carried.x, carried.theta, carried.height, carried.length) == (0.02, 1.5, 0.1, 0.24)


def test_a_lens_file_is_read_as_written(tmp_path: Path) -> None:
    lens = Lens(1280, 720, 920.5, 921.0, 640.0, 350.0, (0.1, 0.2, 0.3, 0.4, 0.0), 0.12)
    lens.save(tmp_path / "lens.yaml")
    assert Lens.load(tmp_path / "lens.yaml") == lens
    (tmp_path / "lens.yaml").write_text("schema: 1\nwidth: 5\n")
    with pytest.raises(CameraFileError, match="is no lens file"):
        Lens.load(tmp_path / "lens.yaml")


def test_a_camera_that_is_not_there_is_one_line_and_exits_with_1(url: str, tmp_path: Path) -> None:
    lens_of(SMALL).save(tmp_path / "lens.yaml")
    floor_file(tmp_path)
    command = [our_command("cmr-camera"), "--lcm-url", url, "99"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert result.returncode == 1
    assert re.fullmatch(r"cmr-camera: The camera 99 cannot be opened; .*\n", result.stderr)


@pytest.mark.parametrize(
    ("has_lens", "told"), [(False, "There is no lens.yaml. 'cmr-camera calibrate'"), (True, "There is no floor.yaml")]
)
def test_what_has_to_be_made_first_is_told(
    has_lens: bool, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if has_lens:
        lens_of(SMALL).save(tmp_path / "lens.yaml")
    with pytest.raises(CommandError, match=told):
        main(["0"])


def test_a_network_camera_that_does_not_answer_is_told_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "PATIENCE", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"rtsp://127.0.0.1:{silent.getsockname()[1]}/stream"
        with pytest.raises(SourceError, match=f"{address} does not send pictures"):
            sources.Camera(address, (640, 480), 30.0, 0.0)


def test_pictures_without_the_board_calibrate_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((90, 160), 128, np.uint8))
    with pytest.raises(CommandError, match="The board is seen in 0 pictures; 8 are needed"):
        main(["calibrate", str(tmp_path), "--lens", str(tmp_path / "lens.yaml")])
    assert not (tmp_path / "lens.yaml").exists()
    assert capsys.readouterr().out == "0 pictures with the board\n"


# Sources and videos


def test_a_video_keeps_the_time_of_its_pictures(tmp_path: Path) -> None:
    video = Video(tmp_path / "run.mkv", 10.0)
    for tenth in (0, 1, 2, 5, 6):  # none at 0.3 and 0.4 s: the picture before stays
        video.take(Taken(EPOCH + 100_000 * tenth, np.full((48, 64, 3), 40 * tenth, np.uint8)))
    video.close()
    shown = frames(tmp_path / "run.mkv")
    assert [round(float(taken.picture.mean()) / 40.0) for taken in shown] == [0, 1, 2, 5, 5, 5, 6]
    assert [round((taken.utime - shown[0].utime) / 1e5) for taken in shown] == list(range(7))


def test_pictures_named_by_their_time_come_in_its_order(tmp_path: Path) -> None:
    for k in (2, 0, 1):
        cv2.imwrite(str(tmp_path / f"{EPOCH + k}.png"), np.full((8, 8), k, np.uint8))
    assert [(taken.utime, int(taken.picture[0, 0, 0])) for taken in frames(tmp_path)] == [
        (EPOCH + k, k) for k in range(3)
    ]


def test_what_is_no_source_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="There are no pictures"):
        Film(tmp_path, 30.0)
    with pytest.raises(SourceError, match="neither a video nor a folder"):
        Film(tmp_path / "nothing.mkv", 30.0)
    with pytest.raises(SourceError, match="a video's name ends with"):
        Video(tmp_path / "run.gif", 10.0)


class LostCamera:
    """A camera that is pulled out after its first picture, and back at the second try."""

    ends = False

    def __init__(self) -> None:
        self.calls = 0

    def read(self) -> Taken:
        self.calls += 1
        if self.calls == 2:
            raise SourceError("The camera is gone.")
        time.sleep(0.005)
        return Taken(self.calls, np.zeros((360, 640), np.uint8))

    def open(self) -> "LostCamera":
        self.calls += 1
        if self.calls == 3:
            raise SourceError("The camera cannot be opened.")
        return self

    def close(self) -> None:
        """Nothing to do."""


def test_a_camera_that_was_lost_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watching, "AGAIN", 0.01)
    camera: Any = LostCamera()
    watched = Watching(camera, camera.open, Watcher(lens_of(SMALL), floor_of()))
    wait_until(lambda: watched.pictures >= 3)
    watched.close()
    assert [seen.taken.utime for seen in watched.results()][:3] == [1, 5, 6]
    assert not watched.failed


def wait_until(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_latency_is_told_of_live_pictures() -> None:
    latency = Latency()
    for age in (0.05, 0.06, 0.2):
        latency.take(int((time.time() - age) * 1e6))
    latency.take(EPOCH)  # recorded long ago
    match = re.fullmatch(r"Poses are (\d+) ms old when sent, (\d+) ms at most\.", latency.summary())
    assert match is not None
    assert 60 <= int(match[1]) < 200 <= int(match[2])
    assert latency.summary() == ""
