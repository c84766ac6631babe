"""Convert recordings with commanded speeds for the model: duties that represent the speeds.

`cmr.model.velocity_controller` defines the conversion. If the robot's top wheel speed, the unit of these duties, is not
given, one is chosen with headroom above all commands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cmr.estimation.estimates import Estimate, EstimationError
from cmr.model.command_kinds import DUTY, VELOCITY, WHEEL_SPEED
from cmr.model.velocity_controller import (
    CONTROLLER_DEFINITIONS,
    VelocityController,
    motor_of,
    response_of,
    response_stds,
)
from cmr.parameters.file import COUNTED_WIDTH, MOTOR, ParameterFile, Value
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats

HEADROOM = 2.0  # an unknown top wheel speed, relative to the fastest command
NEARLY_ALL = 0.999  # share of the commands, so that one damaged number does not choose the unit
DIGITS = 2  # significant digits to which the speed of full duty is rounded
GEOMETRY = ("wheel_radius", "base_width")
MIXED = "Some of the recordings have duties (MOTOR_COMMAND_N), others commanded speeds: calibrate them apart."
WITHOUT_WIDTH = (
    "The commands are body velocities (VELOCITY_COMMAND_N). Converting them to wheel speeds needs base_width, or "
    "command_base_width if the robot computes with a different one: give it by --parameters."
)


def controller_of(recordings: Sequence[Recording], nominal: ParameterFile) -> VelocityController | None:
    """Return the velocity controller of the recorded robot; None if it takes duties.

    The kind of recorded commands decides; without any commands, the `nominal` parameters do. Raises EstimationError if
    kinds of commands are mixed, or if a base width is needed and not known.
    """
    kinds = {recording.command_kind for recording in recordings if _commanded(recording)}
    if DUTY in kinds and len(kinds) > 1:
        raise EstimationError(MIXED)
    if DUTY in kinds or not (kinds or nominal.has("top_wheel_speed")):
        return None
    width = nominal.counted_width
    if np.isnan(width) and VELOCITY in kinds:
        raise EstimationError(WITHOUT_WIDTH)
    controller = VelocityController(nominal.value("wheel_radius"), float(np.nan_to_num(width)), 1.0)
    if nominal.has("top_wheel_speed"):
        return replace(controller, top_wheel_speed=nominal.value("top_wheel_speed"))
    return replace(controller, top_wheel_speed=_top_of(recordings, controller))


def as_duties(recording: Recording, controller: VelocityController | None) -> Recording:
    """Return the recording with duties that represent its commanded speeds; unchanged if it has none."""
    if controller is None or recording.converted_from or recording.command_kind == DUTY:
        return recording
    return recording.with_duties(*controller.duties(*_asked(recording, controller)))


def as_motor(nominal: ParameterFile, controller: VelocityController | None) -> ParameterFile:
    """Return nominal parameters with motor parameters equivalent to the controller; unchanged without one."""
    if controller is None:
        return nominal
    values = {name: value for name, value in nominal.values.items() if name not in (*CONTROLLER_DEFINITIONS, *MOTOR)}
    known = {name: value.value for name, value in nominal.values.items()}
    if nominal.has("response_time"):
        motor = motor_of({**known, "top_wheel_speed": controller.top_wheel_speed})
        values |= {name: Value(value) for name, value in motor.items()}
    return replace(nominal, values={**values, COUNTED_WIDTH: Value(controller.base_width)})


def in_words_of(
    estimates: Mapping[str, Estimate], controller: VelocityController | None, correlation: float = 0.0
) -> dict[str, Estimate]:
    """Return estimates with response_time and speed_scale in place of k2_over_k3 and k1; unchanged without a
    controller.

    `correlation` is that of k2_over_k3 and k1.
    """
    if controller is None or not set(MOTOR) <= set(estimates):
        return dict(estimates)
    values, stds = ({name: getattr(estimates[name], what) for name in MOTOR} for what in ("value", "std"))
    response = response_of(values, controller.top_wheel_speed)
    stds = response_stds(values, stds, controller.top_wheel_speed, correlation)
    rest = {name: one for name, one in estimates.items() if name not in MOTOR}
    return {**{name: Estimate(value, stds[name]) for name, value in response.items()}, **rest}


def values_in_words_of(values: Mapping[str, float], controller: VelocityController | None) -> dict[str, float]:
    """Return values by name, as in the parameter file of a robot with this controller."""
    if controller is None:
        return dict(values)
    geometry = {name: values[name] for name in GEOMETRY if name in values}
    rest = {name: value for name, value in values.items() if name not in (*GEOMETRY, *MOTOR, COUNTED_WIDTH)}
    recorded = response_of(values, controller.top_wheel_speed) if set(MOTOR) <= set(values) else {}
    given = {"top_wheel_speed": controller.top_wheel_speed}
    if controller.base_width:
        given["command_base_width"] = controller.base_width
    return {**geometry, **recorded, **given, **rest}


def correlation_of_motor(names: Sequence[str], covariance: Floats) -> float:
    """Return the correlation of k2_over_k3 and k1 among estimates with this covariance; 0 where one is missing."""
    if not set(MOTOR) <= set(names):
        return 0.0
    at, to = (list(names).index(name) for name in MOTOR)
    return float(covariance[at, to] / np.sqrt(covariance[at, at] * covariance[to, to]))


def _commanded(recording: Recording) -> bool:
    return bool(len(recording.duty) or len(recording.wheel_speed_commands) or len(recording.velocity_commands))


def _asked(recording: Recording, controller: VelocityController) -> tuple[Floats, Floats]:
    """Return the commanded wheel speeds [rad/s], (n,) each."""
    if recording.command_kind == WHEEL_SPEED:
        return recording.wheel_speed_commands["psi_left"], recording.wheel_speed_commands["psi_right"]
    recorded = recording.velocity_commands
    left, right = controller.wheels_of_body(recorded["v"], recorded["omega"])
    return left, right


def _top_of(recordings: Sequence[Recording], controller: VelocityController) -> float:
    """Return a top wheel speed [rad/s] with headroom above all commands."""
    asked = [np.abs(_asked(recording, controller)).ravel() for recording in recordings if _commanded(recording)]
    fastest = float(np.quantile(np.concatenate(asked), NEARLY_ALL)) if asked else 0.0
    lowest = CONTROLLER_DEFINITIONS["top_wheel_speed"].lower
    return max(float(f"{HEADROOM * fastest:.{DIGITS}g}"), lowest)
