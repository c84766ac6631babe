"""`cmr-export --to python`: one file without dependencies that steps this robot and reads its sensors."""

from cmr.exporting.carried import what_is_carried
from cmr.exporting.python_statements import ELEMENTARY, called, filled, functions, indented, safe
from cmr.exporting.robot import ExportedRobot
from cmr.model.extended.program import Program, collocation
from cmr.model.extended.step_statements import LONGEST_STEP
from cmr.model.filtering import FILTER_AGES, FILTER_WEIGHTS

SHORTEST = 1e-3  # of a step, as that of cmr.model.commands, whose import takes a second
PREPARE = [  # what `cmr.model.extended.step_statements.COEFFICIENTS` are
    "rate = k1 * k2_over_k3",
    *(
        f"kept_{when}, gained_{when}, grown_{when} = coefficients(rate, {part}dt, dt)"
        for when, part in (("first", "FIRST * "), ("second", "SECOND * "), ("end", ""))
    ),
]
TEMPLATE = '''\
DOCUMENTATION

from bisect import bisect_right
IMPORTS
from operator import itemgetter
from typing import NamedTuple

CONSTANTS
FUNCTIONS

class Readings(NamedTuple):
    """What the sensors say at the time of the robot: wheel angles [rad], yaw rate [rad/s], pose [m, m, rad]."""

    angle_left: float
    angle_right: float
    yaw_rate: float
    x: float
    y: float
    theta: float


class Robot:
    """The robot: `command`, `step`, `read`, and its true state as attributes.

    x, y [m] and theta [rad, counter-clockwise, not wrapped] are the pose of the turning centre; psi_left, psi_right
    [rad/s] the wheel speeds, angle_left, angle_right [rad] how far wheels have turned, domega_left, domega_right
    [rad/s^2] their accelerations, yaw_rate [rad/s]; time [s].
    """

    def __init__(self, x=0.0, y=0.0, theta=0.0, psi_left=0.0, psi_right=0.0, time=0.0, seed=0):
        self.x, self.y, self.theta, self.psi_left, self.psi_right = x, y, theta, psi_left, psi_right
        self.angle_left = self.angle_right = self.domega_left = self.domega_right = 0.0
        self.time, self.seed, self.yaw_rate = time, seed, wheel_radius * (psi_right - psi_left) / base_width
        BEGIN
        REMEMBER
        self._command = duty_left, duty_right
        self._packets, self._count = [(duty_left, duty_right, -inf)], 0
        self._history = [self._now()]

    def command(self, left, right):
        """Drive with these duties, from -1 to 1, until the next command."""
        self._command = min(max(left, -1.0), 1.0), min(max(right, -1.0), 1.0)
SPEEDS
    def step(self, dt):
        """Let dt [s] pass; longer times are split into equal parts of at most LONGEST_STEP, each with a command."""
        parts = max(1, ceil(dt / LONGEST_STEP))
        for _ in range(parts if dt > 0.0 else 0):
            self._step(dt / parts)
            self._history.append(self._now())
        oldest = min(self._moments()[:3])
        known = bisect_right(self._history, oldest, key=itemgetter(0)) - 1
        del self._history[: max(0, min(known, len(self._history) - 2))]

    def _step(self, dt):
        for left, right, span in self._in_force(dt):
            self._drive(left, right, span)

    def _drive(self, command_left, command_right, dt):
        RECALL
        PREPARE
        STEP
        KEEP

    def _in_force(self, dt):
        """Send the command; return those in force over the next dt [s], each with how long it is [s]."""
        left, right = self._command
        PACKET

    def _now(self):
        """Return what sensors may read: time, wheels, yaw rate and pose."""
        wheels = self.angle_left, self.psi_left, self.angle_right, self.psi_right
        return self.time, *wheels, self.yaw_rate, self.x, self.y, self.theta

    def _moments(self):
        """Return which moments [s] the readings of now show: wheels, gyro, the oldest and the newest of the pose."""
        time = self.time
        MOMENTS
        return encoder_moment, gyro_moment, moment - FILTER[-1][0] * filtered, moment, filtered

    def _around(self, moment):
        """Return what was known before and after a moment, and its place between them; outside it stands still."""
        history = self._history
        behind = min(max(bisect_right(history, moment, key=itemgetter(0)), 1), len(history) - 1)
        before, behind = history[max(behind - 1, 0)], history[behind]
        span = behind[0] - before[0]
        return before, behind, min(max((moment - before[0]) / span, 0.0), 1.0) if span > 0.0 else 1.0

    def read(self):
        """Return what the sensors say now, without noise."""
        time = self.time
        encoder_moment, gyro_moment, _, pose_moment, filtered = self._moments()
        before, behind, place = self._around(encoder_moment)
        span = behind[0] - before[0]
        reading_left = turned(span, place, before[1], behind[1], before[2], behind[2])
        reading_right = turned(span, place, before[3], behind[3], before[4], behind[4])
        ENCODER
        before, behind, place = self._around(gyro_moment)
        reading = yaw_rate = before[5] + place * (behind[5] - before[5])
        GYRO
        x = y = theta = 0.0
        for age, weight in FILTER:
            before, behind, place = self._around(pose_moment - age * filtered)
            x = x + weight * (before[6] + place * (behind[6] - before[6]))
            y = y + weight * (before[7] + place * (behind[7] - before[7]))
            theta = theta + weight * (before[8] + place * (behind[8] - before[8]))
        POSE
        return Readings(reading_left, reading_right, reading, x, y, theta)
'''
TURNED = '''\
def turned(span, place, before, behind, speed_before, speed_behind):
    """Return a wheel's angle [rad] between two known ones, with known speeds [rad/s], `span` [s] apart: cubic."""
    step = behind - before
    bend = (1.0 - place) * (span * speed_before - step) - place * (span * speed_behind - step)
    return before + place * step + place * (1.0 - place) * bend
'''
SPEEDS = '''
    def command_speeds(self, left, right):
        """Drive with these wheel speeds [rad/s] until the next command."""
        self.command(left / TOP_WHEEL_SPEED, right / TOP_WHEEL_SPEED)

    def command_body(self, v, omega):
        """Drive with this speed [m/s] and turn rate [rad/s] until the next command."""
        difference = 0.5 * COMMAND_BASE_WIDTH * omega
        self.command_speeds((v - difference) / COMMAND_WHEEL_RADIUS, (v + difference) / COMMAND_WHEEL_RADIUS)

'''
LATE = """\
seed, count, robot = self.seed, self._count, 0
PACKET
packet = self._packets[-1] if lost else (left, right, self.time + delay)
self._packets.append(packet)
self._count += 1
spans, until = [], 1.0
for number in reversed(range(len(self._packets))):
    left, right, arrival = self._packets[number]
    place = max((arrival - self.time) / dt, -1.0)
    if abs(place - floor(place + 0.5)) < SHORTEST:
        place = floor(place + 0.5)
    if place < until:
        since = max(place, 0.0)
        spans.append((left, right, (until - since) * dt))
        until = since
    if place <= 0.0:
        del self._packets[:number]
        break
return reversed(spans)
"""


def python_file(robot: ExportedRobot) -> str:
    """Return the source of a Python file that steps this robot."""
    program = robot.program
    constants = program.constants
    never_zero = [name for name, constant in constants.items() if constant.value]
    lines = {
        "BEGIN": safe(program.begin, never_zero),
        "PREPARE": PREPARE,
        "STEP": safe(program.step, never_zero),
        "PACKET": _packet(program, never_zero),
        "MOMENTS": safe(moments(program), never_zero),
        **{stage.upper(): safe(program.sensors[stage], never_zero) for stage in ("encoder", "gyro", "pose")},
    }
    used = called(line for part in ("BEGIN", "PREPARE", "STEP", "ENCODER", "GYRO", "POSE") for line in lines[part])
    used |= called(program.packet)
    sources = [*functions(used), TURNED]
    everything = used | called(sources) | {"ceil", "inf"} | ({"floor"} if program.is_late else set())
    parts = {name: indented(part) for name, part in lines.items()}
    names = (*program.state, "yaw_rate")
    parts |= {
        "DOCUMENTATION": _documentation(robot),
        "IMPORTS": f"from math import {', '.join(n for n in ('ceil', *ELEMENTARY, 'nan') if n in everything)}\n",
        "CONSTANTS": "\n".join([*_constants(robot), "\n"]),
        "FUNCTIONS": "\n" + "\n\n".join(sources) + "\n",
        "REMEMBER": indented(f"self.{name} = {name}" for name in program.memory),
        "RECALL": indented(f"{name} = self.{name}" for name in program.state),
        "KEEP": indented(f"self.{name} = {name if name != 'yaw_rate' else 'yaw_rate_end'}" for name in names),
        "SPEEDS": "\n" if robot.controller is None else SPEEDS,
    }
    return filled(TEMPLATE, parts)


def _packet(program: Program, never_zero: list[str]) -> list[str]:
    if not program.is_late:
        return ["return [(left, right, dt)]"]
    text = filled(LATE, {"PACKET": indented(safe(program.packet, never_zero), 0)})
    return text.splitlines()


def moments(program: Program) -> list[str]:
    """Return the statements that compute the times that readings show: those of wheels, gyro and pose."""
    sensors = program.sensors
    return [
        *("moment = time", *sensors["encoder_time"], "encoder_moment = moment"),
        *("moment = time", *sensors["gyro_time"], "gyro_moment = moment"),
        *("moment, filtered = time, 0.0", *sensors["pose_time"]),
    ]


def filter_of(program: Program) -> list[tuple[float, float]]:
    """Return the ages of the poses that approximate a filtered one, in time constants, and their weights."""
    if not any(line.startswith("filtered") for line in program.sensors["pose_time"]):
        return [(0.0, 1.0)]
    return [(float(age), float(weight)) for age, weight in zip(FILTER_AGES, FILTER_WEIGHTS, strict=True)]


def _constants(robot: ExportedRobot) -> list[str]:
    program = robot.program
    lines = [
        f"{name} = {_number(constant.value)}  # [{constant.definition.unit}] {constant.definition.meaning}"
        for name, constant in robot.constants.items()
    ]
    if robot.controller is not None:
        lines += [
            f"TOP_WHEEL_SPEED = {robot.controller.top_wheel_speed!r}  # [rad/s] duty 1 stands for it",
            f"COMMAND_WHEEL_RADIUS = {robot.controller.wheel_radius!r}  # [m] by which (v, omega) counts",
            f"COMMAND_BASE_WIDTH = {robot.controller.base_width!r}  # [m]",
        ]
    lines += [
        f"LONGEST_STEP = {LONGEST_STEP}  # [s]",
        *([f"SHORTEST = {SHORTEST}  # of a step, in which a command comes"] if program.is_late else []),
        "# Ages of the poses that stand for a smoothed one, in time constants, and their weights.",
        f"FILTER = {filter_of(program)!r}",
        *(f"{name} = {value!r}" for name, value in collocation().items()),
    ]
    return [*lines, "MASK = 2**64 - 1"] if "random_number" in called(program.packet) else lines


def _number(value: float) -> str:
    return {float("inf"): "inf", float("-inf"): "-inf"}.get(value, repr(value))


def _documentation(robot: ExportedRobot) -> str:
    """Return the docstring of the file."""
    lines = [
        f"Robot {robot.robot_id} of Calibrated Mixed Reality, as it was calibrated: written by cmr-export.",
        "",
        "It needs nothing but Python 3.10. SI units and radians; x forward, y left, theta counter-clockwise.",
        "",
        f"    robot = {'Robot()':<24}  # at the origin, at rest",
        "    robot.command(0.5, 0.4)" if robot.controller is None else "    robot.command_body(0.2, 0.5)",
        "    robot.step(0.01)",
        "    print(robot.x, robot.y, robot.theta, robot.read())",
        "",
        *what_is_carried("python", robot),
    ]
    # Descriptions of laws are free text, which must not end the docstring.
    text = "\n".join(lines).replace("\\", "\\\\").replace('"""', "'''")
    return f'"""{text}\n"""\n'
