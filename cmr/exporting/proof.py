"""`cmr-export --prove`: run the exported robot, if that is possible here, and CMR's own model on the same drive.

The drive is synthetic, so nothing was fitted to it: curves in both directions, reversals, and rests.
"""

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.cli.errors import CommandError
from cmr.exporting.arrivals import in_force, prompt
from cmr.exporting.carried import FMU, MJCF, PYTHON, Carry, of_robot
from cmr.exporting.robot import ExportedRobot
from cmr.model.motion import RobotState, drive
from cmr.model.parameters import RobotParameters

Floats = NDArray[np.float64]
STEP, SECONDS = 0.01, 60.0  # s
ROUND, REST = 9.0, 1.0  # s; each round begins with a rest
SEED = 1
FAR = 0.01  # share of a path's length by which a target with its own physics may deviate
SAME = 1e-6  # m, by which a target that steps the model may deviate
POSE = ("x", "y", "theta")
READINGS = ("encoder_left", "encoder_right", "gyro_yaw_rate", "tracked_x", "tracked_y", "tracked_theta")  # of the FMU
NEEDED = {FMU: "fmpy", MJCF: "mujoco"}


class Driven(NamedTuple):
    """Motion of an exported robot, and its sensor readings after each step.

    `poses` are x, y [m] and the heading [rad], (n, 3); `readings` are those of both encoders [rad], the gyro [rad/s]
    and a tracker (x, y [m], heading [rad]), (n, 6).
    """

    poses: Floats
    readings: Floats


class Proof(NamedTuple):
    """The same drive by CMR and by the exported robot, with the `readings` (n, 6) of `Driven`.

    Each path is x, y [m] and the heading [rad] after each step, (n, 3): of CMR's robot, of the exported one, and of
    CMR's robot without the effects that the target does not carry.
    """

    target: str
    expected: Floats
    found: Floats
    carried: Floats
    readings: Floats

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(np.hypot(*np.diff(self.expected[:, :2], axis=0).T).sum())

    @property
    def off(self) -> float:
        """The largest distance between the robot's path and the exported robot's [m]."""
        return farthest(self.expected, self.found)

    @property
    def lost(self) -> float:
        """Largest deviation that the effects which are not carried would cause [m]."""
        return farthest(self.expected, self.carried)

    @property
    def off_of_carried(self) -> float:
        """Largest distance to the path of a robot that has only the carried effects [m]."""
        return farthest(self.carried, self.found)

    @property
    def holds(self) -> bool:
        """Whether the exported robot moves as its carried effects predict."""
        return self.off_of_carried <= (FAR * self.length if self.target == MJCF else SAME)


def farthest(one: Floats, other: Floats) -> float:
    """Return the largest distance [m] between two paths, (n, 2 or more), at the same times."""
    return float(np.max(np.hypot(*(one[:, :2] - other[:, :2]).T)))


def check_provable(target: str) -> None:
    """Refuse a target that cannot be run here, before anything slow. Raises CommandError."""
    if target not in RUN:
        raise CommandError(f"{target} cannot be run here, so nothing can be proven; {', '.join(RUN)} can.")
    library = NEEDED.get(target)
    if library and find_spec(library) is None:
        raise CommandError(f"To run {target}, install {library}: pip install {library}")


def prove(robot: ExportedRobot, target: str, path: Path) -> Proof:
    """Run CMR's robot and the exported one in `path` on the same drive; return both.

    Raises CommandError if the target cannot be run.
    """
    check_provable(target)
    left, right = duties()
    kept = {name for name, one in of_robot(target, robot).items() if one.how is not Carry.NOT}
    driven = RUN[target](robot, path, left, right)
    return Proof(
        target,
        _driven(robot.parameters, left, right),
        driven.poses,
        _driven(_with_only(robot, kept), left, right),
        driven.readings,
    )


def duties() -> tuple[Floats, Floats]:
    """Return the duties of both sides for each step of the drive, within [-0.8, 0.8]."""
    time = np.arange(0.0, SECONDS, STEP)
    moves = time % ROUND >= REST
    left = 0.45 * np.sin(0.9 * time) + 0.35 * np.sign(np.sin(0.5 * time))
    right = 0.5 * np.sin(0.7 * time + 1.0) + 0.3
    return np.where(moves, left, 0.0), np.where(moves, right, 0.0)


def _with_only(robot: ExportedRobot, names: set[str]) -> RobotParameters:
    """Return a robot's parameters with only the effects that have these names."""
    off = {
        parameter.name for effect in robot.effects if effect.name not in names for parameter in effect.all_parameters
    }
    return RobotParameters.of({name: value for name, value in robot.parameters.values.items() if name not in off})


def _driven(parameters: RobotParameters, left: Floats, right: Floats) -> Floats:
    spans = in_force(parameters, left, right, np.full(len(left), STEP), SEED)
    motion = drive(spans.left, spans.right, spans.dt, prompt(parameters), RobotState.at_rest(), spans.ends)
    return np.stack([motion.x, motion.y, motion.theta], axis=1)


def _in_python(_robot: ExportedRobot, path: Path, left: Floats, right: Floats) -> Driven:
    names: dict[str, Any] = {"__name__": path.stem}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    robot = names["Robot"](seed=SEED)
    poses, readings = np.empty((len(left), 3)), np.empty((len(left), 6))
    for number, command in enumerate(zip(left.tolist(), right.tolist(), strict=True)):
        robot.command(*command)
        robot.step(STEP)
        poses[number] = robot.x, robot.y, robot.theta
        readings[number] = robot.read()
    return Driven(poses, readings)


def _in_fmpy(robot: ExportedRobot, path: Path, left: Floats, right: Floats) -> Driven:
    import fmpy

    names, commands = ("duty_left", "duty_right"), (left, right)
    if robot.controller is not None:
        names, commands = ("v", "omega"), robot.controller.body_velocity(left, right)
    time = np.arange(len(left)) * STEP
    inputs = np.array(list(zip(time, *commands, strict=True)), dtype=[(name, float) for name in ("time", *names)])
    found = fmpy.simulate_fmu(
        str(path),
        stop_time=len(left) * STEP,
        step_size=STEP,
        output_interval=STEP,
        input=inputs,
        start_values={"seed": SEED},
        output=[*POSE, *READINGS],
    )
    poses, readings = (np.stack([found[name][1:] for name in names], axis=1) for names in (POSE, READINGS))
    return Driven(poses, readings)


def _in_mujoco(robot: ExportedRobot, path: Path, left: Floats, right: Floats) -> Driven:
    import mujoco

    model: Any = mujoco.MjModel.from_xml_path(str(path))
    data: Any = mujoco.MjData(model)
    full = 1.0 if robot.controller is None else robot.controller.top_wheel_speed
    poses, readings = np.empty((len(left), 3)), np.empty((len(left), 6))
    for number, command in enumerate(zip(full * left, full * right, strict=True)):
        data.ctrl[:] = command
        for _ in range(round(STEP / model.opt.timestep)):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)  # a step leaves the sensors' values of its beginning
        poses[number] = [data.joint(name).qpos[0] for name in POSE]
        encoders = [data.sensor(name).data[0] for name in ("encoder_left", "encoder_right")]
        readings[number] = [*encoders, data.sensor("gyro").data[2], *poses[number]]
    return Driven(poses, readings)


RUN: Mapping[str, Callable[[ExportedRobot, Path, Floats, Floats], Driven]] = {
    PYTHON: _in_python,
    FMU: _in_fmpy,
    MJCF: _in_mujoco,
}
