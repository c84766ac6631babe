"""A robot that is calibrated by what a camera sees of it has the parameters that it really has: all on the bus."""

import dataclasses
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from cmr.bus.bus import Bus
from cmr.bus.streams import CALIBRATION_STATUS, POSE, identify
from cmr.parameters.file import load
from tests.support.bus_bench import PATIENCE, our_command, receive_until
from tests.support.camera_bench import floor_file, lens_of
from tests.support.emulated_drive import DEFAULT, TRUTH, Message, messages
from tests.support.rendered_floor import Box, Eye, Scene, Sheet

pytestmark = pytest.mark.waits

EVERY = 10  # poses of the emulator from one picture to the next: there are 5 pictures a second
SECONDS = 18.0  # of driving: a lobe to the right, and one to the left
REST = 5.0  # s before and after it; a drive at one speed ends after 3 s, and half a second more for stragglers
TAGS = tuple(
    Sheet(number, x, y, 0.3 * number)
    for number, x, y in ((10, -1.0, -0.35), (11, 0.8, -0.35), (12, 0.8, 0.7), (13, -1.0, 0.7))
)
EYE = Eye(640, 360, 430.0, (322.0, 178.0), position=(-0.1, -0.1, 1.8), looks_at=(-0.1, 0.17, 0.0))


def turning(share: float) -> tuple[float, float]:
    """Duties of lobes that fit under the camera."""
    difference = 0.2 * np.sin(2.0 * np.pi * share)
    return float(0.3 - difference), float(0.3 + difference)


def drive() -> list[Message]:
    """What the emulated robot says of its drive, and, as POSE_0, exactly where it is."""
    exact = dataclasses.replace(DEFAULT.imperfections.pose_noise, position=0.0, heading=0.0)
    settings = dataclasses.replace(DEFAULT, imperfections=dataclasses.replace(DEFAULT.imperfections, pose_noise=exact))
    return messages(settings, seconds=SECONDS, rest=REST, duties=turning)


def take_pictures(folder: Path, driven: list[Message]) -> int:
    """Render what the camera sees of a drive; return how many pictures there are."""
    folder.mkdir()
    room = Scene(EYE, TAGS, parts=3)
    places = [message for channel, message in driven if channel == POSE.channel(0)][::EVERY]
    for place in places:
        picture = room.picture([Box(place.x, place.y, place.theta, 0)])
        cv2.imwrite(str(folder / f"{place.utime}.png"), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return len(places)


@contextmanager
def running(*command: str, folder: Path) -> Iterator["subprocess.Popen[str]"]:
    """A command of ours, which ends by itself."""
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def tell(bus: Bus, driven: list[Message]) -> int:
    """Say what the robot says, up to each picture as the camera's process has seen it; return how many it has seen."""
    said = seen = 0
    others = [(channel, message) for channel, message in driven if channel != POSE.channel(0)]
    while said < len(others):
        heard = receive_until(bus, lambda received: any(entry.stream is POSE for entry in received))
        poses = [entry.message.utime for entry in heard if entry.stream is POSE]
        seen += len(poses)
        is_last = poses[-1] > driven[-1][1].utime - 2 * EVERY * 20_000
        while said < len(others) and (is_last or others[said][1].utime <= poses[-1]):
            channel, message = others[said]
            stream, robot_id = identify(channel) or (POSE, None)
            bus.publish(stream, message, robot_id)
            said += 1
    return seen


@pytest.mark.further  # tests/camera/ measures how exact poses are, and publishes them; poses that are less so calibrate
def test_parameters_from_the_cameras_poses_are_within_3_percent(url: str, tmp_path: Path) -> None:
    driven = drive()
    pictures = take_pictures(tmp_path / "pictures", driven)
    lens_of(EYE).save(tmp_path / "lens.yaml")
    floor_file(tmp_path, TAGS)
    bus = Bus(url)
    for stream in (POSE, CALIBRATION_STATUS):
        bus.subscribe(stream, every=True)
    calibrate = (our_command("cmr-calibrate"), "--lcm-url", url, "--out", "robot_0.yaml")
    camera = (our_command("cmr-camera"), "--lcm-url", url, "pictures", "--image-rate", "0")
    with running(*calibrate, folder=tmp_path) as calibrating:
        receive_until(bus, lambda received: len(received) > 0)  # it hears
        with running(*camera, folder=tmp_path) as watching:
            seen = tell(bus, driven)
            assert watching.wait(PATIENCE) == 0
        said, _ = calibrating.communicate(timeout=6.0 * PATIENCE)  # on a busy machine that compiles it, too
    assert (calibrating.returncode, seen >= 0.95 * pictures) == (0, True), said
    found = load(tmp_path / "robot_0.yaml")
    assert {name: found.value(name) for name in TRUTH} == pytest.approx(TRUTH, rel=0.03)
