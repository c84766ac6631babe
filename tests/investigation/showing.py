"""Which effects a floor can show: how many deviations each makes of a random drive, by the independent plant alone.

Short movements, drawn like an investigation's, are driven one after the other if the robot stays on the floor. The
typical robot drives them, and the same with an effect of usual size, from the same state at the beginning of each span
of SPAN seconds: by more the paths must not part, as a robot that is followed knows where it is. The differences of
their readings, filtered, make a squared distance; what other parameters of the robot could do themselves is taken off.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cmr.geometry.obstacles import Geofence
from cmr.investigation.floor import Floor
from cmr.investigation.movements import PERIOD, Movement, candidates
from cmr.plant.parameters import Floats, plant_parameters
from cmr.plant.running import PLACES, RunningRobot
from cmr.plant.sensors import SILENT, TURN
from tests.hidden_effects.robots import TYPICAL_ROBOT
from tests.investigation.filtering import DT, EVERY_POSE, Along, whitened
from tests.investigation.investigated import SQUARE, DrivenRobot
from tests.reference_plant import TYPICAL
from tests.reference_plant.drives import NOMINAL_TICKS

TABLE = Path(__file__).with_name("shown.csv")
SECONDS, SPAN = 60.0, 20.0  # s
COASTING = 0.6  # s
AT_ONCE = 20  # movements that are drawn together
ENOUGH = 6.0  # deviations with which an effect counts as shown
PARAMETERS = {"k1": 0.01, "k2_over_k3": 0.03, "base_width": 0.01}  # shares of small changes
TIMES = {"payload_change_time": 15.0, "surface_change_time": 15.0}  # s: in the middle third of 30 s
PLACE = {"surface_patch_x": 0.4, "surface_patch_y": 0.0}  # m
READ_OFF = ("encoder_quantisation",)  # the ticks
WITHOUT = ("command_jitter", "command_loss", "wheel_separation_error", "pose_smoothing", "wheel_speed_latency")
EFFECTS = tuple(name for name in TYPICAL if name not in (*WITHOUT, *READ_OFF))


def random_drive(seed: int, fence: Geofence = SQUARE) -> Floats:
    """Return the duties of SECONDS of movements on which the typical robot stays on the floor, (n, 2)."""
    random, floor = np.random.default_rng(seed), Floor(fence)
    robot = plant_parameters(TYPICAL_ROBOT)
    scout = RunningRobot(robot, (0.0, 0.0, 0.0), SILENT.of_motion, 0)
    drawn: list[Movement] = []
    parts: list[Floats] = []
    while sum(map(len, parts)) < round(SECONDS / PERIOD):
        drawn = drawn or candidates(random, AT_ONCE)
        duty = drawn.pop().duty
        before = scout.carried.copy()
        if _stays(scout, duty, floor):
            parts.append(duty)
        else:
            scout.carried[:] = before
    return np.concatenate(parts)[: round(SECONDS / PERIOD)]


def _stays(scout: RunningRobot, duty: Floats, floor: Floor) -> bool:
    """Drive these duties, and tell whether the robot stays on the floor with them, and when it coasts after them."""
    places = [_driven(scout, *sides) for sides in duty]
    there = scout.carried.copy()
    places += [_driven(scout, 0.0, 0.0) for _ in range(round(COASTING / PERIOD))]
    scout.carried[:] = there
    x, y = np.array(places).T
    return bool(np.all(floor.room(x, y) > 0.0))


def _driven(scout: RunningRobot, left: float, right: float) -> tuple[float, float]:
    scout.drive(left, right)
    scout.advance(scout.time + PERIOD)
    return float(scout.carried[PLACES["x"]]), float(scout.carried[PLACES["y"]])


def deviations(duty: Floats, effects: Sequence[str]) -> dict[str, float]:
    """Return by how many standard deviations each effect of usual size differs from none on a drive, by name."""
    plain = _Driving(duty, {}, ())
    hidden = [{name: TYPICAL_ROBOT[name] * (1.0 + share)} for name, share in PARAMETERS.items()]
    hidden += [_usual(effect) for effect in effects]
    others = [_Driving(duty, one, plain.begins) for one in hidden]
    products = np.zeros((len(hidden), len(hidden)))
    for number in range(len(plain.begins)):
        white = whitened(plain.along(number), *_differences(plain, others, number))
        products += white.T @ white
    own = len(PARAMETERS)
    left = products[own:, own:] - products[own:, :own] @ np.linalg.solve(products[:own, :own], products[:own, own:])
    return dict(zip(effects, np.sqrt(np.maximum(np.diag(left), 0.0)).tolist(), strict=True))


def _usual(effect: str) -> dict[str, float]:
    return {**TYPICAL[effect], **{name: v for name, v in {**TIMES, **PLACE}.items() if name in TYPICAL[effect]}}


class _Driving:
    """A drive of a robot with something hidden: its readings; `begins` are its states as each span begins.

    Each span begins with the pose, the wheel angles and the wheel speeds of the states given, if any.
    """

    def __init__(self, duty: Floats, hidden: Mapping[str, float], begins: Sequence[Mapping[str, float]]) -> None:
        driven = DrivenRobot({**TYPICAL_ROBOT, **hidden}, SILENT)
        self.begins: list[dict[str, float]] = []
        for number, sides in enumerate(duty):
            if number % round(SPAN / PERIOD) == 0:
                if begins:
                    driven.put(begins[len(self.begins)])
                self.begins.append(driven.state)
            driven.drive(float(sides[0]), float(sides[1]), PERIOD)
        recording = driven.recording()
        wheels, poses = recording.wheels, recording.poses
        self._wheels = np.stack([wheels["ticks_left"], wheels["ticks_right"]], axis=1) * TURN / NOMINAL_TICKS
        self._gyro = recording.gyro["yaw_rate"]
        self._poses = np.stack([poses["x"], poses["y"], np.unwrap(poses["theta"])], axis=1)
        self._psi = np.stack([wheels["psi_left"], wheels["psi_right"]], axis=1)

    def along(self, number: int) -> Along:
        """Return the headings and wheel speeds of one span."""
        rows, of_poses = _rows(number)
        theta = np.interp(
            np.arange(len(self._gyro[rows])), np.arange(0, len(self._gyro[rows]), EVERY_POSE), self._poses[of_poses, 2]
        )
        return Along(theta, self._psi[rows])

    def readings(self, number: int) -> tuple[Floats, Floats, Floats]:
        """Return the readings of wheels (n, 2), gyro (n,) and poses (m, 3) in one span."""
        rows, of_poses = _rows(number)
        return self._wheels[rows], self._gyro[rows], self._poses[of_poses]


def _rows(number: int) -> tuple[slice, slice]:
    """Return which readings of wheels and gyro, and which poses, are those of a span."""
    count = round(SPAN / DT)
    poses = count // EVERY_POSE
    return slice(number * count, (number + 1) * count), slice(number * poses, (number + 1) * poses)


def _differences(plain: _Driving, others: Sequence[_Driving], number: int) -> tuple[Floats, Floats, Floats]:
    """Return by how much the readings of some drives differ from those of the plain one, drive by drive at the end."""
    own = plain.readings(number)
    wheels, gyro, poses = (
        np.stack([one.readings(number)[k] - own[k] for one in others], axis=-1) for k in range(len(own))
    )
    turned = poses[:, 2]
    poses[:, 2] = np.remainder(turned + math.pi, TURN) - math.pi
    return wheels, gyro, poses


def shown() -> dict[str, tuple[float, int]]:
    """Return the table: by how many deviations the best drive shows each effect on SQUARE, and of how many drives."""
    with TABLE.open(newline="", encoding="utf-8") as stream:
        return {row["effect"]: (float(row["deviations"]), int(row["drives"])) for row in csv.DictReader(stream)}
