"""A robot that is calibrated by what a camera sees of it has the parameters that it really has."""

import dataclasses

import numpy as np
import pytest

from cmr.bus.messages import make
from cmr.calibration.calibrator import Calibrator
from cmr.camera.watcher import Watcher
from cmr.msg import pose_xyt_t
from tests.camera_bench import floor_of, lens_of
from tests.emulated_drive import DEFAULT, TRUTH, messages
from tests.rendered_floor import Box, Eye, Scene, Sheet

EVERY = 10  # poses of the emulator that pass between two pictures: there are 5 pictures a second
TAGS = tuple(
    Sheet(number, x, y, 0.3 * number)
    for number, x, y in ((10, -0.55, -0.1), (11, 2.05, -0.1), (12, 2.0, 1.45), (13, -0.5, 1.4))
)
EYE = Eye(640, 360, 430.0, (322.0, 178.0), position=(0.7, 0.2, 2.5), looks_at=(0.74, 0.66, 0.0))


def turning(share: float) -> tuple[float, float]:
    """Duties of a figure-eight that fits under the camera."""
    difference = 0.16 * np.sin(2.0 * np.pi * share)
    return float(0.3 - difference), float(0.3 + difference)


def test_parameters_from_the_cameras_poses_are_within_3_percent() -> None:
    exact = dataclasses.replace(DEFAULT.imperfections.pose_noise, position=0.0, heading=0.0)
    settings = dataclasses.replace(DEFAULT, imperfections=dataclasses.replace(DEFAULT.imperfections, pose_noise=exact))
    watcher, room = Watcher(lens_of(EYE), floor_of(TAGS)), Scene(EYE, TAGS, parts=3)
    calibrator, seen, there = Calibrator(0), 0, 0
    for channel, message in messages(settings, duties=turning):
        if channel == "POSE_0":
            there += 1
            if there % EVERY:
                continue
            poses = watcher.watch(room.picture([Box(message.x, message.y, message.theta, 0)]))
            if 0 not in poses:
                continue
            seen, pose = seen + 1, poses[0]
            message = make(pose_xyt_t, utime=message.utime, robot_id=0, x=pose.x, y=pose.y, theta=pose.theta)
        calibrator.handle(message.utime, channel, message)
    assert seen >= 0.95 * (there // EVERY), watcher.rejected
    assert calibrator.fit() is not None, calibrator.failure
    assert calibrator.result is not None
    found = {name: calibrator.result.estimates[name].value for name in TRUTH}
    assert found == pytest.approx(TRUTH, rel=0.03)
