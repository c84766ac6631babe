"""Exported robots to be driven, in Python and in compiled C, and the drive that they share."""

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, TypeAlias

import numpy as np

from cmr.exporting.arrivals import in_force, prompt
from cmr.exporting.c_source import c_header, c_source
from cmr.exporting.python_file import python_file
from cmr.exporting.robot import ExportedRobot
from cmr.model.catalogue import MODELLED, typical
from cmr.model.motion import Floats, RobotState, drive
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import motor_of

Spans: TypeAlias = tuple[Floats, Floats, Floats]
PAPER = (0.04, 118.0, 0.054, 0.161)
MOMENT = 20.0037  # s; what sets in at a time does so within a step
STATE = ("x", "y", "theta", "psi_left", "psi_right", "angle_left", "angle_right")
# A robot with a velocity controller: top wheel speed 6.67 rad/s.
SPEEDS = RobotParameters.of(
    {"wheel_radius": 0.033, "base_width": 0.16, **motor_of({"response_time": 0.1, "top_wheel_speed": 6.67})}
)
COMPILER = shutil.which("cc")
# Six effects each, of all groups.
ROBOTS = (
    ("command_delay", "command_jitter", "slew_limit", "static_friction", "turn_slip", "pose_latency"),
    ("command_loss", "electrical_lag", "coulomb_friction", "backlash", "wheel_wobble", "gyro_latency"),
    ("battery_sag", "battery_drift", "motor_heating", "motor_coupling", "surface_patch", "wheel_speed_latency"),
    ("deadband", "turn_rate_limit", "quadratic_drag", "slope", "longitudinal_slip", "pose_smoothing"),
    ("saturation", "current_limit", "payload_change", "surface_change", "lateral_skid", "encoder_quantisation"),
)


def robot_with(effects: Sequence[str]) -> ExportedRobot:
    """Return a robot with effects at their typical sizes."""
    values = {name: size for effect in effects for name, size in typical(MODELLED[effect]).items()}
    values = {name: MOMENT if name.endswith("_change_time") else size for name, size in values.items()}
    return ExportedRobot(0, RobotParameters(*PAPER, effects=values))


def commands(seconds: float) -> tuple[Floats, Floats, Floats]:
    """Return duties of both sides and how long each lasts [s]: curves, stops, reversals; steps of several lengths."""
    random = np.random.default_rng(7)
    dt = random.choice([0.01, 0.012, 0.02, 0.0073], size=int(seconds / 0.008))
    time = np.cumsum(dt)
    dt, time = dt[time <= seconds], time[time <= seconds]
    left = 0.45 * np.sin(0.9 * time) + 0.35 * np.sign(np.sin(0.5 * time))
    right = 0.5 * np.sin(0.7 * time + 1.0) + 0.3
    rests = (time % 9.0) < 1.0
    return np.where(rests, 0.0, left), np.where(rests, 0.0, right), dt


def driven_by_cmr(robot: ExportedRobot, spans: Spans, seed: int = 0) -> Floats:
    """Return the state at the end of each span, columns STATE, as CMR simulates it."""
    left, right, dt, ends = in_force(robot.parameters, *spans, seed)
    motion = drive(left, right, dt, prompt(robot.parameters), RobotState.at_rest(), ends)
    return np.stack([getattr(motion, name) for name in STATE], axis=1)


def module_of(robot: ExportedRobot) -> ModuleType:
    """Return the exported Python file as a module."""
    module = ModuleType("exported_robot")
    exec(compile(python_file(robot), "exported_robot.py", "exec"), module.__dict__)
    return module


def driven_in_python(robot: ExportedRobot, spans: Spans, seed: int = 0) -> tuple[Floats, Floats]:
    """Return the state and the readings at the end of each span, as the Python file has them."""
    one = module_of(robot).Robot(seed=seed)
    return _driven(one, spans, lambda: one, lambda: one.read())


class CRobot:
    """The exported C source, compiled into a folder."""

    def __init__(self, robot: ExportedRobot, folder: Path, seed: int = 0) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "cmr_robot.h").write_text(c_header(robot))
        (folder / "cmr_robot.c").write_text(c_source(robot))
        options = [
            "-std=c99",
            "-O1",
            "-ffp-contract=off",
            "-Wall",
            "-Wextra",
            "-Wno-unused-but-set-variable",
            "-Werror",
        ]
        command = [str(COMPILER), *options, "-fPIC", "-shared", "-o", "robot.so", "cmr_robot.c", "-lm"]
        subprocess.run(command, cwd=folder, check=True)
        self._library = ctypes.CDLL(str(folder / "robot.so"))
        for function in ("command", "step", "begin"):
            getattr(self._library, f"cmr_robot_{function}").restype = ctypes.c_int
        self._memory = ctypes.create_string_buffer(65536)
        self._library.cmr_robot_begin(self._memory, *map(ctypes.c_double, (0.0,) * 6), ctypes.c_uint64(seed))

    def command(self, left: float, right: float) -> None:
        self._library.cmr_robot_command(self._memory, ctypes.c_double(left), ctypes.c_double(right))

    def step(self, dt: float) -> None:
        assert self._library.cmr_robot_step(self._memory, ctypes.c_double(dt))

    def state(self) -> Any:
        return SimpleNamespace(**dict(zip(STATE, (ctypes.c_double * 7).from_buffer(self._memory), strict=True)))

    def read(self) -> list[float]:
        readings = (ctypes.c_double * 6)()
        self._library.cmr_robot_read(self._memory, readings)
        return list(readings)

    def end(self) -> None:
        self._library.cmr_robot_end(self._memory)


def driven_in_c(robot: ExportedRobot, spans: Spans, folder: Path, seed: int = 0) -> tuple[Floats, Floats]:
    """Return the state and the readings at the end of each span, as the C source has them."""
    one = CRobot(robot, folder, seed)
    result = _driven(one, spans, one.state, one.read)
    one.end()
    return result


def _driven(robot: Any, spans: Spans, state: Any, read: Any) -> tuple[Floats, Floats]:
    states, readings = [], []
    for left, right, dt in zip(*(span.tolist() for span in spans), strict=True):
        robot.command(left, right)
        robot.step(dt)
        now = state()
        states.append([getattr(now, name) for name in STATE])
        readings.append(list(read()))
    return np.array(states), np.array(readings)
