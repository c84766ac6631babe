"""Parameters that change duties much, whoever sends them, are used by a pilot when its robot rests, not before."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import make, now_utime
from cmr.bus.process import Process
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PARAMETERS, POSE, PROCESS_STATUS, WORLD_STATE
from cmr.model.motion import RobotState
from cmr.msg import gyro_t, motor_command_t, pose_xyt_t
from cmr.parameters.caution import LARGEST_CHANGE, REST, STANDING, Caution, duties_for
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import AnyBehaviour, FigureEight
from cmr.world.pilot import Pilot
from cmr.world.refusals import refusals
from cmr.world.view import REAL, Robot, world_messages
from cmr.world.world import World
from robot_driver.emulator.plant import Plant
from tests.support.emulated_drive import DEFAULT, EPOCH, _feedback
from tests.support.pilot_bench import StraightOn
from tests.support.private_bus import private_url
from tests.support.typed_messages import as_a
from tests.world.test_world import TRUE

LATER = 2**62  # a version that is newer than any


def with_values(**values: float) -> ParameterFile:
    return ParameterFile(0, {**TRUE.values, **{name: Value(value) for name, value in values.items()}})


HUGE_WHEELS = with_values(wheel_radius=1.9)


class ClosedLoop:
    """A robot that a pilot drives, with the world that estimates it: turns of 10 ms."""

    def __init__(self, folder: Path, behaviour: AnyBehaviour) -> None:
        file = folder / "robot_0.yaml"
        TRUE.save(file)
        self.plant, self.pilot = Plant(DEFAULT), Pilot(0, behaviour, ParameterFollower(0, file), keep_clear=False)
        self.world = World([], lambda robot_id: ParameterFollower(robot_id, file))
        self.utime, self.ticks, self.duties = EPOCH, (0.0, 0.0), (0.0, 0.0)

    def turn(self) -> tuple[float, float]:
        """Let 10 ms pass; return the duties in force."""
        self.utime += 10_000
        self.plant.advance((self.utime - EPOCH) * 1e-6)
        for channel, message in self._measured():
            self.world.handle(self.utime, channel, message)
            self.pilot.handle(self.utime, channel, message)
        self.world.advance(self.utime)
        for message in world_messages(self.world.utime, self.world.everybody()):
            self.pilot.handle(self.utime, WORLD_STATE.name, message)
        command = as_a(motor_command_t, self.pilot.command(self.utime))
        self.duties = command.left, command.right
        self.plant.command(*self.duties)
        self.world.handle(self.utime, MOTOR_COMMAND.channel(0), command)
        return self.duties

    def largest_duty(self, seconds: float) -> float:
        return max(max(map(abs, self.turn())) for _ in range(int(seconds * 100)))

    def announce(self, parameters: ParameterFile) -> None:
        for handler in (self.world, self.pilot):
            handler.handle(self.utime, PARAMETERS.channel(0), parameters.announcement(sequence=LATER))

    def _measured(self) -> Iterator[tuple[str, Any]]:
        counts, scale = self.plant.encoder_counts(), 6.283185307179586 / DEFAULT.robot.ticks_per_turn
        psi = [(new - old) * scale / 0.01 for new, old in zip(counts, self.ticks, strict=True)]
        self.ticks = counts
        yield MOTOR_FEEDBACK.channel(0), _feedback(self.utime, counts, psi, *self.duties)
        rate = DEFAULT.robot.wheel_radius * (psi[1] - psi[0]) / DEFAULT.robot.base_width
        stamps = {"utime": self.utime, "robot_id": 0}
        yield GYRO.channel(0), make(gyro_t, **stamps, yaw_rate=rate, valid=1, received_utime=self.utime)
        place = {"x": self.plant.x, "y": self.plant.y, "theta": self.plant.theta}
        yield POSE.channel(0), make(pose_xyt_t, **stamps, **place)


@pytest.mark.parametrize("absurd", [HUGE_WHEELS, with_values(k1=0.13)], ids=["huge wheels", "slow motors"])
@pytest.mark.slow
def test_absurd_parameters_do_not_change_how_a_robot_drives(tmp_path: Path, absurd: ParameterFile) -> None:
    loop = ClosedLoop(tmp_path, FigureEight(start=0.0, laps=50))
    loop.largest_duty(4.0)
    usual = loop.largest_duty(8.0)
    loop.announce(absurd)
    loop.turn()
    assert loop.world._models[0] == absurd.robot_parameters  # of the twin
    assert loop.largest_duty(8.0) == pytest.approx(usual, rel=0.1)
    assert "0.3 m/s from" in loop.pilot.new_parameters
    assert loop.pilot.parameters_sha256 == TRUE.announcement(sequence=1).sha256
    estimate_waits = any("New parameters of robot 0" in sentence for sentence in refusals(loop.world, loop.utime))
    assert estimate_waits == (absurd is HUGE_WHEELS)


def test_they_are_used_when_it_rests(tmp_path: Path) -> None:
    behaviour = StraightOn(0.3, 0.3)
    loop = ClosedLoop(tmp_path, behaviour)
    loop.largest_duty(3.0)
    loop.announce(HUGE_WHEELS)
    loop.largest_duty(1.0)
    real = loop.world._real[0]
    assert real.estimator.parameters is not None
    assert real.estimator.parameters.wheel_radius == 0.04
    behaviour.duties = (0.0, 0.0)
    loop.largest_duty(2.0)
    assert loop.pilot.new_parameters == ""
    assert refusals(loop.world, loop.utime) == []
    assert loop.pilot.parameters_sha256 == HUGE_WHEELS.announcement(sequence=1).sha256
    assert real.estimator.parameters.wheel_radius == 1.9


def test_both_duties_are_reported_and_a_person_confirms(tmp_path: Path) -> None:
    loop = ClosedLoop(tmp_path, StraightOn(0.3, 0.3))
    loop.largest_duty(3.0)
    new = with_values(k1=1.6 * TRUE.value("k1"))
    loop.announce(new)
    loop.turn()
    before, after = duties_for(TRUE.robot_parameters), duties_for(new.robot_parameters)
    assert f"the duty for 0.3 m/s from {before[0]:.3f} to {after[0]:.3f}" in loop.pilot.new_parameters
    assert f"turning at 1 rad/s from {before[1]:.3f} to {after[1]:.3f}" in loop.pilot.new_parameters
    loop.pilot.confirm_parameters()
    assert loop.pilot.new_parameters == ""
    assert loop.pilot.parameters_sha256 == new.announcement(sequence=1).sha256


@pytest.mark.parametrize("name", ["k1", "wheel_radius", "base_width"])
def test_a_change_by_less_than_that_is_used_at_once(tmp_path: Path, name: str) -> None:
    loop = ClosedLoop(tmp_path, StraightOn(0.3, 0.3))
    loop.largest_duty(3.0)
    loop.announce(with_values(**{name: 0.8 * TRUE.value(name)}))
    loop.turn()
    assert loop.pilot.new_parameters == ""
    assert loop.pilot.parameters_sha256 != TRUE.announcement(sequence=1).sha256


@pytest.mark.parametrize(
    "new",
    [
        replace(TRUE, values={"wheel_radius": Value(0.04)}),
        ParameterFile(
            0, {name: Value(0.2) for name in ("wheel_radius", "base_width", "response_time", "top_wheel_speed")}
        ),
    ],
    ids=["incomplete", "of a robot that takes speeds"],
)
def test_parameters_by_which_it_cannot_be_driven_wait_too(tmp_path: Path, new: ParameterFile) -> None:
    loop = ClosedLoop(tmp_path, StraightOn(0.3, 0.3))
    loop.largest_duty(3.0)
    loop.announce(new)
    assert loop.turn() == (0.3, 0.3)
    assert "cannot be driven by them in the same way" in loop.pilot.new_parameters


def test_what_is_withdrawn_waits_no_more() -> None:
    caution = Caution[float](lambda value: (value,))
    caution.offer(1.0)
    caution.note_motion(EPOCH, 1.0, 0.0)
    caution.offer(1.0 + 2.0 * LARGEST_CHANGE)
    assert (caution.now, caution.waiting) == (1.0, 1.0 + 2.0 * LARGEST_CHANGE)
    caution.offer(1.0)
    assert (caution.now, caution.waiting) == (1.0, None)


@pytest.mark.parametrize("share", [0.9, 1.1, 1.29])
def test_many_small_changes_are_a_large_one(share: float) -> None:
    caution = Caution[float](lambda value: (value,))
    caution.offer(1.0)
    caution.note_motion(EPOCH, 1.0, 1.0)
    for step in range(1, 20):
        caution.offer(share**step)
        assert caution.now is not None
        assert abs(caution.now - 1.0) <= LARGEST_CHANGE
    assert caution.waiting == share**19
    caution.note_motion(EPOCH + REST, 0.0, 0.0)
    assert caution.now == share**19


def test_after_a_rest_or_a_persons_word_changes_count_anew() -> None:
    caution = Caution[float](lambda value: (value,))
    caution.offer(1.0)
    for now in range(1, 5):
        caution.note_motion(EPOCH + 2 * now * REST, 1.0, 1.0)
        caution.offer(1.25**now)
        assert (caution.now, caution.waiting) == (1.25**now, None)
        caution.note_motion(EPOCH + (2 * now + 1) * REST, 0.0, 0.0)
    caution.note_motion(EPOCH + 12 * REST, 1.0, 1.0)
    caution.offer(9.0)
    caution.confirm()
    caution.offer(9.0 * 1.25)
    assert (caution.now, caution.waiting) == (9.0 * 1.25, None)


def test_wheels_that_stand_for_a_moment_are_no_rest() -> None:
    caution = Caution[float](lambda value: (value,))
    caution.offer(1.0)
    for utime, psi in ((0, 1.0), (REST - 1, 0.0), (REST, -STANDING), (2 * REST - 1, 0.0)):
        caution.note_motion(EPOCH + utime, psi, psi)
        caution.offer(2.0)
        assert caution.now == 1.0
    caution.note_motion(EPOCH + 2 * REST, 0.0, 0.0)
    assert caution.now == 2.0


@pytest.mark.waits
@pytest.mark.real_time
def test_the_terminal_says_so_and_a_signal_confirms(tmp_path: Path) -> None:
    """The process itself, on a bus of its own, with a robot that drives in WORLD_STATE."""
    TRUE.save(tmp_path / "robot_0.yaml")
    url, huge = private_url(), HUGE_WHEELS.announcement(sequence=1).sha256
    command = [sys.executable, "-m", "cmr", "pilot", "--robot", "0", "--lcm-url", url]
    pilot = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    said: list[tuple[float, str, str]] = []  # when, what, and the digest of the parameters in use
    try:
        with Process("test", url) as process:
            process.subscribe(PROCESS_STATUS, every=True)
            for utime in process.loop(rate_hz=50.0):
                now = time.monotonic()
                moving = Robot(utime, 0, REAL, RobotState(0.0, 0.0, 0.0, 5.0, 5.0, 0.0, 0.0))
                process.publish_all((WORLD_STATE, None, world) for world in world_messages(utime, [moving]))
                statuses = [received.message_of(PROCESS_STATUS) for received in process.received()]
                said += [(now, one.message, one.parameters_sha256) for one in statuses if one and one.pid == pilot.pid]
                if said and now > said[0][0] + 2.0:  # by then it has seen that its robot moves
                    process.publish(PARAMETERS, HUGE_WHEELS.announcement(sequence=now_utime()), 0)
                if said and f"kill -USR1 {pilot.pid}" in said[-1][1]:
                    assert said[-1][2] == TRUE.announcement(sequence=1).sha256
                    os.kill(pilot.pid, signal.SIGUSR1)
                if (said and said[-1][2] == huge) or pilot.poll() is not None:
                    break
    finally:
        pilot.terminate()
        _, terminal = pilot.communicate(timeout=10.0)
    assert said[-1][2] == huge
    assert "New parameters of robot 0 wait until it rests: they change the duty for 0.3 m/s from 0.4" in terminal
