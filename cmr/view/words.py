"""The panels' contents as HTML: tables and sentences. Everything from the bus is escaped."""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

from cmr.bus.message import Message
from cmr.bus.streams import (
    GYRO,
    MOTOR_FEEDBACK,
    PARAMETERS,
    Stream,
)
from cmr.model.parameters import DEFINITIONS
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS, VelocityController, response_of, response_stds
from cmr.msg import calibration_status_t, motor_command_t, motor_feedback_t, process_status_t, wheel_speed_command_t
from cmr.parameters.file import ParameterFile, ParameterFileError, parse
from cmr.recordings.arrivals import COMMANDS_OF, Command
from cmr.report.markup import tag
from cmr.view.data.robots import REAL, TWIN, VIRTUAL
from cmr.view.data.state import ViewState
from cmr.view.drawing import bar, distance, paths_drawing
from cmr.view.inputs import plain

SILENT = 3.0  # s without a report after which a process counts as silent
CONFIDENCE = 1.96  # standard deviations on either side of a 95 % interval
STYLE = "font-size:11px;line-height:1.3;padding:2px 12px;overflow-x:auto"
KEEP = "white-space:nowrap"
CELL = "padding:1px 5px 1px 0;vertical-align:top;text-align:left"
PROCESS_STATES = {
    process_status_t.STARTING: "starting",
    process_status_t.RUNNING: "running",
    process_status_t.DEGRADED: "degraded",
    process_status_t.STOPPING: "stopped",
}
STATUS_WORDS = {
    motor_feedback_t.STATUS_ESTOP: "the emergency stop is engaged",
    motor_feedback_t.STATUS_COMMAND_STALE: "no fresh command, so the motors get zero",
    motor_feedback_t.STATUS_NOT_ARMED: "not armed: the controller's watchdog could not be set",
    motor_feedback_t.STATUS_TEMPERATURE: "too hot",
    motor_feedback_t.STATUS_BATTERY: "the battery is low or unknown",
    motor_feedback_t.STATUS_MOTOR_FAULT: "a motor has a fault or draws too much current",
    motor_feedback_t.STATUS_ENCODER_JUMP: "an encoder jumped",
}
CALIBRATION_STATES = {
    calibration_status_t.WAITING: "waiting for the robot to move",
    calibration_status_t.COLLECTING: "watching the manoeuvre",
    calibration_status_t.FITTING: "computing",
    calibration_status_t.DONE: "done",
    calibration_status_t.FAILED: "failed",
}
ESTIMATED = ("k2_over_k3", "k1", "base_width")  # the parameters that a calibration_status_t has
# Parameters to show, with units: robots with a velocity controller have the middle two instead of the first.
ESTIMATES = (
    ("k2_over_k3", "rad/s²"),
    ("k1", "s/rad"),
    ("response_time", "s"),
    ("speed_scale", "-"),
    ("base_width", "m"),
)
MEANINGS = {name: parameter.meaning for name, parameter in {**DEFINITIONS, **CONTROLLER_DEFINITIONS}.items()}


def command_words(command: Command) -> str:
    """Describe a command, with units."""
    if isinstance(command, motor_command_t):
        return f"left {command.left:+.2f}, right {command.right:+.2f} duty"
    if isinstance(command, wheel_speed_command_t):
        return f"left {command.psi_left:+.2f}, right {command.psi_right:+.2f} rad/s"
    return f"{command.v:+.2f} m/s, turning {command.omega:+.2f} rad/s"


def status_words(status: int) -> str:
    """Describe the status bits of a motor_feedback_t."""
    words = [word for bit, word in STATUS_WORDS.items() if status & bit]
    unknown = status & ~sum(STATUS_WORDS)
    words += [f"unknown status {unknown:#x}"] if unknown else []
    return "; ".join(words) or "healthy"


def processes(state: ViewState) -> str:
    """Return the table of processes, with the message of each below it."""
    rows: list[tuple[object, ...]] = []
    for (name, host, pid), reported in sorted(state.processes.items()):
        message, age = reported.message, (state.now - reported.utime) / 1e6
        condition = PROCESS_STATES.get(message.state, str(message.state))
        if age > SILENT and condition != "stopped":
            condition = f"silent for {age:.0f} s"
        parameters = " ".join(sha[:7] for sha in message.parameters_sha256.split(","))
        rate = f"{message.loop_rate_hz:.1f}"
        rows.append((name, f"{host}:{pid}", condition, rate, f"{message.loop_overruns:.0f}", parameters))
        if message.message:
            rows.append((("", message.message),))
    return table(("process", "host:pid", "state", "Hz", "overruns", "parameters"), rows)


def bus(state: ViewState) -> str:
    """Return the table of channels."""
    rows = [
        (
            *(line.channel, f"{line.rate:.1f}", _size(line.bytes_per_second), f"{line.age:.1f} s"),
            *("-" if line.gaps is None else line.gaps, line.errors),
        )
        for line in state.traffic.lines(state.now)
    ]
    return table(("channel", "Hz", "B/s", "age", "gaps", "not taken"), rows)


def robot(state: ViewState, robot_id: int) -> str:
    """Return a table about one robot."""
    robots = state.present()
    rows: list[tuple[object, ...]] = []
    for origin, name in ((REAL, "real"), (VIRTUAL, "virtual"), (TWIN, "twin")):
        group = robots.of(origin)
        for place in (group.robot_id == robot_id).nonzero()[0]:
            x, y, theta = group.pose[:, place]
            left, right = group.wheels[:, place]
            silent = ", silent at the moment" if group.silent[place] else ""
            rows.append((name, f"x {x:.3f} m, y {y:.3f} m, heading {math.degrees(theta):.1f}°{silent}"))
            rows.append(("", f"wheels {_number(left, '.2f')}, {_number(right, '.2f')} rad/s"))
    if not rows:
        rows.append(("state", "not in the world at present"))
    reported = () if state.has_left(robot_id) else _reported(state, robot_id)
    return table((f"robot {robot_id}", ""), [*rows, *reported])


def _reported(state: ViewState, robot_id: int) -> Iterable[tuple[object, ...]]:
    """Yield rows from a robot's own channels."""
    for stream in COMMANDS_OF.values():
        command = state.newest(stream, robot_id)
        if command is not None:
            yield "command", command_words(command) + _ago(state, stream, robot_id)
    feedback = state.newest(MOTOR_FEEDBACK, robot_id)
    if feedback is not None:
        silence = _ago(state, MOTOR_FEEDBACK, robot_id)
        if silence:
            yield "driver", f"says nothing any more; this was{silence}:"
        if math.isfinite(feedback.applied_left):
            yield "applied", f"left {feedback.applied_left:+.2f}, right {feedback.applied_right:+.2f} duty"
        yield "battery", f"{_number(feedback.battery_voltage, '.1f')} V"
        yield "temperature", f"{_number(feedback.temperature, '.0f')} °C"
        yield "current", f"{_number(feedback.current_left, '.1f')}, {_number(feedback.current_right, '.1f')} A"
        yield "driver", status_words(feedback.status) + silence
    gyro = state.newest(GYRO, robot_id)
    if gyro is not None:
        rate = f"{gyro.yaw_rate:+.3f} rad/s" if gyro.valid else "reports a fault"
        yield "gyro", rate + _ago(state, GYRO, robot_id)
    parameters = state.newest(PARAMETERS, robot_id)
    if parameters is not None:
        yield "parameters", parameters.sha256[:12]
        yield (("", parameter_values(parameters.yaml)),)


@lru_cache(maxsize=64)
def parameter_values(text: str) -> str:
    """Return the parameters common to all robots of its kind from a parameter file; empty if unreadable."""
    known, definitions = _parsed(text), {**DEFINITIONS, **CONTROLLER_DEFINITIONS}
    names = [name for name in definitions if known is not None and known.has(name)]
    return ", ".join(f"{name} {known.value(name):.4g} {definitions[name].unit}" for name in names if known)


@lru_cache(maxsize=64)
def _parsed(text: str) -> ParameterFile | None:
    try:
        return parse(text)
    except ParameterFileError:
        return None


def controller_of(state: ViewState, robot_id: int) -> VelocityController | None:
    """Return the velocity controller of a robot, by its parameters; None if it takes duties or is unknown."""
    announced = state.newest(PARAMETERS, robot_id)
    known = None if announced is None else _parsed(announced.yaml)
    try:
        return None if known is None else known.velocity_controller
    except ParameterFileError:
        return None


class Estimate(NamedTuple):
    """A parameter's value and standard deviation, in its unit."""

    value: float
    std: float


def estimated(message: calibration_status_t, controller: VelocityController | None) -> dict[str, Estimate]:
    """Return the known parameters of a calibration_status_t, by the names of the robot's file."""
    values = {name: getattr(message, name) for name in ESTIMATED if math.isfinite(getattr(message, name))}
    stds = {name: getattr(message, f"{name}_std") for name in values}
    if controller is not None and {"k2_over_k3", "k1"} <= set(values):
        top = controller.top_wheel_speed
        response, response_std = response_of(values, top), response_stds(values, stds, top)
        rest = {name: value for name, value in values.items() if name not in ("k2_over_k3", "k1")}
        values, stds = {**response, **rest}, {**response_std, **stds}
    return {name: Estimate(value, stds[name]) for name, value in values.items()}


def _ago(state: ViewState, stream: Stream[Message], robot_id: int) -> str:
    """Return the age of a robot's last message on a stream, in words; empty if it is fresh."""
    age = (state.now - state.latest[stream.name][robot_id].utime) / 1e6
    return f" {age:.0f} s ago" if age > SILENT else ""


def calibration(message: calibration_status_t, controller: VelocityController | None = None) -> str:
    """Describe a calibration_status_t, for a robot with this velocity controller."""
    rows: list[tuple[object, ...]] = [("state", CALIBRATION_STATES.get(message.state, message.state))]
    known = estimated(message, controller)
    own = (*(("response_time", "speed_scale") if controller else ESTIMATED[:2]), ESTIMATED[2])
    for name, unit in ESTIMATES:
        if name in known:
            one = known[name]
            rows.append((name, f"{one.value:.4g} ± {_number(CONFIDENCE * one.std, '.2g')} {unit} (95 %)"))
        elif name in own:
            rows.append((name, "not known"))
        if name in (*known, *own):
            rows.append((("", MEANINGS[name]),))
    for name, error in (("old", message.path_rmse_before), ("new", message.path_rmse_after)):
        reported = f"simulated path {distance(error)} off (rms)" if math.isfinite(error) else "not known"
        rows.append((f"{name} values", reported))
    title = f"calibration of robot {message.robot_id}"
    seen = sentence(f"manoeuvre seen: {100 * message.progress:.0f} %") + bar(message.progress)
    return table((title, ""), rows) + seen + sentence(message.message)


def drives(state: ViewState, robot_id: int) -> str:
    """Draw the paths of robot and twin on the calibration's drive, and on the one after it."""
    before, after = state.drives.of(robot_id)
    history = state.calibrations.get(robot_id)
    is_done = history is not None and history[-1].message.state == calibration_status_t.DONE
    first = "before calibration" if is_done else "this drive"
    return paths_drawing([(first, before), ("after calibration", after)])


def twins(state: ViewState) -> str:
    """Return the distances of robots from their twins, with the message of the live diagnosis."""
    rows = []
    for robot_id, distances in sorted(state.divergence.items()):
        last = distances[-1][1]
        largest = max(distance for _, distance in distances)
        rows.append((f"robot {robot_id}", distance(last), distance(largest)))
    said = state.diagnosis() or "cmr-diagnose --live would say here what a robot does differently from its twin."
    return table(("", "from its twin", "at most"), rows) + sentence(said)


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; a row of one (key, text) pair is a remark across all columns."""
    lines = [tag("tr", *(tag("th", name, style=f"{CELL};{KEEP}") for name in head))]
    for row in rows:
        if len(row) == 1 and isinstance(row[0], tuple):
            remark = tag("td", str(row[0][1]), colspan=len(head), style=f"{CELL};opacity:.75")
            lines.append(tag("tr", remark))
        else:
            styles = (f"{CELL};{KEEP}", *[CELL] * (len(row) - 1))
            cells = zip(styles, row, strict=True)
            lines.append(tag("tr", *(tag("td", str(cell), style=style) for style, cell in cells)))
    return plain(tag("div", tag("table", *lines), style=STYLE))


def sentence(text: str, colour: str = "inherit") -> str:
    """Return a paragraph."""
    return plain(tag("div", text, style=f"{STYLE};color:{colour}"))


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "?"


def _size(bytes_per_second: float) -> str:
    return f"{bytes_per_second / 1e3:.1f}k" if bytes_per_second >= 1e4 else f"{bytes_per_second:.0f}"
