"""Update the parameter file after bring-up with measured values; everything else is kept."""

from dataclasses import dataclass
from pathlib import Path

from cmr.model.effects.sensors import tracked_point
from cmr.parameters.file import ParameterFile, ParameterFileError, Value, load
from robot_driver.bringup.bench import CannotTell
from robot_driver.bringup.poses_found import PosesFound

WIDTH_STD, MOTOR_STD = 0.03, 0.3  # relative, of a first estimate


@dataclass(frozen=True)
class ParametersFound:
    """Radius of the wheels and base width (m), k2_over_k3 and k1 if known, the gyro's scale, and the poses."""

    wheel_radius: float
    base_width: float
    motors: tuple[float, float] | None
    gyro_scale: float
    poses: PosesFound


def write_parameters(path: Path, robot: int, found: ParametersFound) -> str:
    """Write the parameter file; return its changes. Raises CannotTell if it cannot be read."""
    try:
        old = load(path) if path.exists() else ParameterFile(robot, {})
    except ParameterFileError as error:
        raise CannotTell(f"the parameter file cannot be read: {error}") from error
    if old.robot_id != robot:
        raise CannotTell(f"{path} is of robot {old.robot_id}, not of robot {robot}")
    values, effects = _values(found), _effects(found)
    kept = {name: value for name, value in old.values.items() if name not in values and name not in EFFECTS}
    kept_effects = tuple(name for name in old.effects if name not in EFFECTS)
    new = ParameterFile(
        robot,
        {**kept, **values, **{name: Value(value) for name, value in effects.items()}},
        (*kept_effects, *effects),
        {"by": "cmr bringup"},
    )
    new.save(path)
    before = {name: f"{value.value:.4g} -> " for name, value in old.values.items()}
    changes = [
        f"{name} {before.get(name, '')}{value.value:.4g}"
        for name, value in new.values.items()
        if name not in old.values or old.values[name].value != value.value
    ]
    gone = [name for name in old.effects if name in EFFECTS and name not in effects]
    return ", ".join([*changes, *(f"{name} removed" for name in gone)]) or "unchanged"


EFFECTS = ("gyro_scale", "pose_latency", *tracked_point(0.0, 0.0))


def _values(found: ParametersFound) -> dict[str, Value]:
    values = {"wheel_radius": Value(found.wheel_radius)}
    if found.motors is not None:
        gain, k1 = found.motors
        values |= {"k2_over_k3": Value(gain, MOTOR_STD * gain), "k1": Value(k1, MOTOR_STD * k1)}
    return values | {"base_width": Value(found.base_width, WIDTH_STD * found.base_width)}


def _effects(found: ParametersFound) -> dict[str, float]:
    """Return parameters of sensor effects, by effect name, which equals the parameter's."""
    effects = {}
    if found.gyro_scale != 1.0:
        effects["gyro_scale"] = found.gyro_scale - 1.0
    if found.poses.lateness > 0.0:  # stamps later than the pose are not modelled by an effect
        effects["pose_latency"] = round(found.poses.lateness, 3)
    # A fraction of a millimetre to the left is the noise of the fit.
    offsets = tracked_point(round(found.poses.ahead, 4), round(found.poses.left, 3))
    return effects | {name: offset for name, offset in offsets.items() if offset}
