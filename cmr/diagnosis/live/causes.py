"""Causes of changes, and what to do about them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cmr.diagnosis.live.changes import BY_NAME, Sizes

LEAST_FALL = 0.02  # least relative drop of a battery's voltage that slows the wheels noticeably


@dataclass(frozen=True)
class Voltage:
    """The battery voltage [V] at the start and now; NaN if not reported."""

    start: float
    now: float

    @property
    def known(self) -> bool:
        """Whether the voltage is known."""
        return self.start == self.start and self.now == self.now

    @property
    def fall(self) -> float:
        """The share by which it has fallen; NaN if not reported."""
        return 1.0 - self.now / self.start

    @property
    def steady(self) -> bool:
        """Whether it is known and has not fallen."""
        return self.known and self.fall < LEAST_FALL

    def __str__(self) -> str:
        return f"the battery shows {self.now:.1f} V, {self.start:.1f} V at the start"


@dataclass(frozen=True)
class Cause:
    """One cause. `changes` are the changes it makes, by name, with the sign that they must have: 0 for either.

    `title` names it in a few words, which may depend on the sizes of the changes, by name; `advice` says what to do.
    `effect` is the effect of the catalogue that models it, empty if there is none. `fits` says whether the battery
    voltage is consistent with it; with `tells_voltage`, the sentence includes the voltage. `by_speed` restricts the
    cause to robots that take speeds (True) or duties (False); None for both.
    """

    key: str
    changes: Mapping[str, int]
    title: Callable[[Sizes], str]
    advice: str
    effect: str = ""
    fits: Callable[[Voltage], bool] = lambda _voltage: True
    tells_voltage: bool = False
    by_speed: bool | None = None

    def allows(self, sizes: Sizes) -> bool:
        """Return whether changes of these sizes, by name, can have this cause and are large enough to matter."""
        return all(
            0.5 * BY_NAME[name].size <= abs(sizes[name]) <= BY_NAME[name].largest and sizes[name] * sign >= 0.0
            for name, sign in self.changes.items()
        )

    def sentence(self, sizes: Sizes, voltage: Voltage) -> str:
        """Return a sentence on the observation, the suspected cause, and what to do."""
        seen = " and ".join(BY_NAME[name].clause(sizes[name]) for name in self.changes)
        shows = f"; {voltage}" if self.tells_voltage and voltage.known else ""
        effect = f" (effect {self.effect})" if self.effect else ""
        return f"{seen[0].upper()}{seen[1:]}{shows}. Suspected: {self.title(sizes)}{effect}. {self.advice}"


def _always(text: str) -> Callable[[Sizes], str]:
    return lambda _sizes: text


def _both_slip(sizes: Sizes) -> str:
    held = sizes["slip"] > 0.8
    return "the robot is blocked, or off the ground, while its wheels turn" if held else "both wheels slip"


def _held_back(wheels: str, change: str) -> Cause:
    """Return the cause for wheels that no longer reach the commanded speed as at the start."""
    return Cause(
        f"{change}_held",
        {change: 0},
        lambda sizes: (
            f"the robot's own controller {'holds back' if sizes[change] < 0.0 else 'speeds up'} {wheels}: "
            "a weak battery, something that rubs, or another setting"
        ),
        "Charge the battery, check the wheels and the robot's speed limits; recalibrate if the change persists.",
        by_speed=True,
    )


def _asymmetric(side: str) -> Cause:
    return Cause(
        f"{side}_motor",
        {f"{side}_speed": 0},
        lambda sizes: (
            f"the {side} motor or its gear "
            + ("is braked or weak" if sizes[f"{side}_speed"] < 0.0 else "runs more freely")
        ),
        f"Check whether anything rubs on the {side} side, and the motor connectors; recalibrate if it persists.",
        "motor_gain_asymmetry",
        by_speed=False,
    )


def _slipping(side: str) -> Cause:
    return Cause(
        f"{side}_slip",
        {f"{side}_slip": 1},
        _always(f"the {side} wheel slips"),
        f"Check the {side} wheel for dust, a loose hub or too little weight on it, and the floor for slippery patches.",
    )


CAUSES = (
    Cause(
        "battery",
        {"speed": -1},
        _always("a low battery"),
        "Charge the battery; if it is full, check what brakes both sides.",
        "battery_drift",
        lambda voltage: not voltage.steady,
        tells_voltage=True,
        by_speed=False,
    ),
    Cause(
        "braked",
        {"speed": -1},
        _always("warm motors, a heavier load or a floor with more resistance, not the battery"),
        "Check whether anything rubs; recalibrate if the change persists.",
        "motor_heating",
        lambda voltage: voltage.steady,
        tells_voltage=True,
        by_speed=False,
    ),
    Cause(
        "unbraked",
        {"speed": 1},
        _always("a fuller battery, a lighter load or a floor with less resistance"),
        "Recalibrate if the change persists.",
        "battery_drift",
        by_speed=False,
    ),
    _held_back("both sides' wheels", "speed"),
    _held_back("the left wheels", "left_speed"),
    _held_back("the right wheels", "right_speed"),
    Cause(
        "floor",
        {"speed": 0, "turning": 0},
        _always("the robot is on another floor"),
        "Calibrate on this floor if it stays there.",
        "surface_change",
    ),
    Cause(
        "grip",
        {"turning": 0},
        _always("different grip in turns: another floor, shifted weight, or worn tyres"),
        "Calibrate on this floor if it stays there.",
        "surface_change",
    ),
    Cause(
        "load",
        {"response": 0},
        lambda sizes: (
            "a heavier load (the top speed is the same), or commands that arrive later"
            if sizes["response"] > 0.0
            else "a lighter load (the top speed is the same)"
        ),
        "Check what the robot carries and the delay of its commands; recalibrate if the change persists.",
        "payload_change",
        by_speed=False,
    ),
    Cause(
        "later",
        {"response": 0},
        lambda sizes: f"commands that arrive {'later' if sizes['response'] > 0.0 else 'sooner'}, or another load",
        "Check the network, the delay of its commands and what it carries; recalibrate if the change persists.",
        by_speed=True,
    ),
    _asymmetric("left"),
    _asymmetric("right"),
    _slipping("left"),
    _slipping("right"),
    Cause("slip", {"slip": 1}, _both_slip, "Check the robot, its wheels and the floor."),
    Cause(
        "skid",
        {"skid": 0},
        lambda sizes: f"a floor that is {'more' if sizes['skid'] > 0.0 else 'less'} slippery sideways",
        "Drive turns more slowly, or calibrate on this floor.",
        "lateral_skid",
    ),
    Cause(
        "gyro_offset",
        {"gyro_offset": 0},
        _always("the gyro's zero has drifted; the robot is unchanged"),
        "Let the gyro warm up, and let the robot stand still until the driver has measured the zero again.",
        "gyro_bias",
    ),
    Cause(
        "gyro_factor",
        {"gyro_factor": 0},
        lambda sizes: (
            "the gyro no longer measures turns"
            if sizes["gyro_factor"] < -0.8
            else "the gyro has changed, not the robot"
        ),
        "Check how the gyro is mounted and connected.",
        "gyro_scale",
    ),
    Cause(
        "pose_late",
        {"pose_late": 0},
        _always("the localisation is late, or its clock is off; not the robot"),
        "Check the load of the localisation computer and its clock.",
        "pose_latency",
    ),
    Cause(
        "pose_way",
        {"pose_way": 0},
        _always("the scale of the localisation, or a change in tyre pressure"),
        "Measure a straight run with a tape: if the poses are right, check the tyres.",
        "wheel_radius_scale",
    ),
    Cause(
        "pose_still",
        {"pose_still": 0},
        _always("the localisation is at fault, not the robot"),
        "Check whether the localisation still sees the robot.",
    ),
)
