"""Settings of the emulated robot: read from YAML, checked once, immutable."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeAlias

import yaml

from cmr.documents.document import read, read_file
from cmr.documents.structure import Names, structured
from cmr.plant.parameters import PlantParameters, plant_parameters
from robot_driver.emulator.requiring import SettingsError, require, require_positive, require_possible

__all__ = ["Settings", "SettingsError", "load_settings"]

DEFAULT_FILE = Path(__file__).with_name("default.yaml")

ROBOT_PARAMETERS = ("wheel_radius", "k2_over_k3", "k1", "base_width")
EFFECT_PARAMETERS = tuple(name for name in PlantParameters._fields if name not in ROBOT_PARAMETERS)
Effects: TypeAlias = Annotated[dict[str, float], Names(EFFECT_PARAMETERS)]  # parameters of the plant, by name
IMPERFECTIONS_OF_PLANT = (
    *("coulomb_friction", "static_friction", "battery_sag", "command_delay"),
    *("turn_slip", "longitudinal_slip", "gyro_bias", "pose_latency"),
)


@dataclass(frozen=True)
class Robot:
    """The true robot: geometry in m, motors as in domega = k2_over_k3 V - k1 k2_over_k3 psi, pose at the start."""

    wheel_radius: float
    k2_over_k3: float
    k1: float
    base_width: float
    ticks_per_turn: float
    x: float
    y: float
    theta: float

    def __post_init__(self) -> None:
        require_positive(self, "wheel_radius", "k2_over_k3", "k1", "base_width", "ticks_per_turn")
        # The plant steps 1 ms at a time; it cannot follow motors that answer within two steps.
        require(self.k1 * self.k2_over_k3 < 500.0, "below 500/s", "k1 k2_over_k3")


@dataclass(frozen=True)
class Mounting:
    """How motors, encoders and gyro are mounted and connected.

    Motors swapped: the first channel drives the right wheels. Encoders swapped: each channel counts the wheels that the
    other one drives. A dead encoder never counts. `gyro_factor`: reading of the gyro for a turn of 1.
    """

    motors_swapped: bool
    encoders_swapped: bool
    left_motor_inverted: bool
    right_motor_inverted: bool
    left_encoder_inverted: bool
    right_encoder_inverted: bool
    left_encoder_dead: bool
    right_encoder_dead: bool
    gyro_factor: float


@dataclass(frozen=True)
class Cameras:
    """Errors in the set-up of the cameras: handedness of the frame, axes, units, and the body.

    Headings are reported `heading_offset` (rad) too large; a metre and a radian are reported as these numbers. Vertical
    y: the reported y is the height. With another `body`, a stationary object is tracked instead of the robot.
    """

    mirrored: bool
    heading_offset: float
    vertical_y: bool
    metre: float
    radian: float
    other_body: bool

    def __post_init__(self) -> None:
        require_positive(self, "metre", "radian")


@dataclass(frozen=True)
class Electrics:
    """Voltages in V, the current of one stalled motor at full duty in A, temperature in degrees Celsius."""

    battery_voltage: float
    logic_voltage: float
    stall_current: float
    temperature: float

    def __post_init__(self) -> None:
        require_positive(self, "battery_voltage", "logic_voltage", "stall_current")


@dataclass(frozen=True)
class Roboclaw:
    """The motor controller on its serial line."""

    address: int
    baud: int
    status_bytes: int

    def __post_init__(self) -> None:
        require(0x80 <= self.address <= 0x87, "0x80 to 0x87", "address")
        require(self.baud >= 0, "0 or more", "baud")
        require(self.status_bytes in (1, 2, 4), "1, 2 or 4", "status_bytes")


@dataclass(frozen=True)
class Roboteq:
    """The other motor controller: its serial line, and the settings in its flash: watchdog in ms, echo."""

    baud: int
    watchdog: int
    echo: bool
    ignores_watchdog: bool

    def __post_init__(self) -> None:
        require(self.baud >= 0, "0 or more", "baud")
        require(0 <= self.watchdog <= 65000, "0 to 65000", "watchdog")


@dataclass(frozen=True)
class Mbot:
    """The board with wheels and gyro on one port: rate of its loop in Hz, watchdog in s.

    `topics_from` is added to the numbers of all topics that it sends.
    """

    rate: float
    watchdog: float
    ignores_watchdog: bool
    takes_velocities: bool
    topics_from: int

    def __post_init__(self) -> None:
        require_positive(self, "rate", "watchdog")
        require(0 <= self.topics_from <= 60000, "0 to 60000", "topics_from")


@dataclass(frozen=True)
class SpeedLoop:
    """The velocity loop in a motor controller on a serial line: gains as shares of the full duty.

    `p` for an error of the full speed, `i` in 1/s, `d` in s.
    """

    p: float
    i: float
    d: float

    def __post_init__(self) -> None:
        require(min(self.p, self.i, self.d) >= 0, "0 or more", "p, i and d")


@dataclass(frozen=True)
class Controller:
    """How wheels follow commanded speeds, by a controller inside the robot; SI units, `rate` in Hz."""

    rate: float
    response_time: float
    speed_scale: float
    top_wheel_speed: float
    command_base_width: float

    def __post_init__(self) -> None:
        require_positive(self, "rate", "response_time", "speed_scale", "top_wheel_speed", "command_base_width")
        require(self.response_time > 0.002, "greater than 0.002 s", "response_time")
        require(self.rate <= 500.0, "500 Hz or less", "rate")


@dataclass(frozen=True)
class Dsp3000:
    """The gyro on its serial line: rate in Hz, start-up in s."""

    rate: float
    baud: int
    start_up: float

    def __post_init__(self) -> None:
        require_positive(self, "rate")
        require(self.baud >= 0, "0 or more", "baud")
        require(self.start_up >= 0, "0 or more", "start_up")


@dataclass(frozen=True)
class KvhBinary:
    """The other gyro on its serial line: rate in Hz, start-up in s; angles in rad unless set otherwise.

    `clock_error` is the relative error of its clock, positive if fast.
    """

    rate: int
    clock_error: float
    baud: int
    start_up: float
    sends_rate: bool
    degrees: bool

    def __post_init__(self) -> None:
        allowed = (1, 5, 10, 25, 50, 100, 250, 500, 750, 1000, 3600, 5000)
        require(self.rate in allowed, f"one of {', '.join(map(str, allowed))}", "rate")
        require(self.clock_error > -1, "greater than -1", "clock_error")
        require(self.baud >= 0, "0 or more", "baud")
        require(self.start_up >= 0, "0 or more", "start_up")


@dataclass(frozen=True)
class Imperfection:
    """One departure from the ideal robot; its unit stands in default.yaml."""

    enabled: bool
    size: float

    @property
    def effective(self) -> float:
        """The size, or 0 if it is switched off."""
        return self.size if self.enabled else 0.0


@dataclass(frozen=True)
class TorqueNoise(Imperfection):
    """Acceleration noise of each wheel, rad/s^2, with a correlation time in s."""

    correlation_time: float

    def __post_init__(self) -> None:
        require_positive(self, "correlation_time")


@dataclass(frozen=True)
class EncoderQuantisation:
    """The encoder's disc: it shows only this many positions in a turn."""

    enabled: bool
    ticks_per_turn: float

    def __post_init__(self) -> None:
        require_positive(self, "ticks_per_turn")


@dataclass(frozen=True)
class PoseNoise:
    """Standard deviations of the external pose: position in m (each of x and y), heading in rad."""

    enabled: bool
    position: float
    heading: float

    def __post_init__(self) -> None:
        require(min(self.position, self.heading) >= 0, "0 or more", "position and heading")


@dataclass(frozen=True)
class Imperfections:
    """Everything that makes the robot differ from the ideal one."""

    coulomb_friction: Imperfection
    static_friction: Imperfection
    battery_sag: Imperfection
    torque_noise: TorqueNoise
    command_delay: Imperfection
    turn_slip: Imperfection
    longitudinal_slip: Imperfection
    slip_noise: Imperfection
    encoder_quantisation: EncoderQuantisation
    gyro_bias: Imperfection
    gyro_noise: Imperfection
    pose_noise: PoseNoise
    pose_latency: Imperfection

    # Noise of the sensors. All others violate the model of the motion, or bias a measurement.
    MEASUREMENT = ("encoder_quantisation", "gyro_noise", "pose_noise")

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            imperfection = getattr(self, field.name)
            if isinstance(imperfection, Imperfection) and field.name != "gyro_bias":
                require(imperfection.size >= 0, "0 or more", field.name, "size")

    def ideal(self) -> "Imperfections":
        """Return a copy in which only the noise of the sensors is left."""
        model_errors = (field.name for field in dataclasses.fields(self) if field.name not in self.MEASUREMENT)
        off = {name: dataclasses.replace(getattr(self, name), enabled=False) for name in model_errors}
        return dataclasses.replace(self, **off)


@dataclass(frozen=True)
class Settings:
    """The whole emulated robot."""

    seed: int
    robot: Robot
    mounting: Mounting
    cameras: Cameras
    electrics: Electrics
    roboclaw: Roboclaw
    roboteq: Roboteq
    mbot: Mbot
    speed_loop: SpeedLoop
    velocity_controller: Controller
    dsp3000: Dsp3000
    kvh_binary: KvhBinary
    imperfections: Imperfections
    effects: Effects

    def __post_init__(self) -> None:
        for name, value in self.effects.items():
            require_possible(name, value, "effects", name)
        for name in IMPERFECTIONS_OF_PLANT:
            require_possible(name, getattr(self.imperfections, name).size, "imperfections", name, "size")
        ticks = self.imperfections.encoder_quantisation.ticks_per_turn
        require_possible("encoder_quantisation", ticks, "imperfections", "encoder_quantisation", "ticks_per_turn")

    @property
    def plant(self) -> PlantParameters:
        """The plant of the true robot: with the effects named, else with the imperfections."""
        return self._plant_with({})

    @property
    def plant_of_speeds(self) -> PlantParameters:
        """The same robot with its velocity controller in place of motors that take duties; k1 is set by its top speed.

        Commanded speeds in rad/s times k1 take the place of duties in the plant.
        """
        controller = self.velocity_controller
        return self._plant_with(
            {
                "k1": 1.0 / controller.top_wheel_speed,
                "controller_response_time": controller.response_time,
                "controller_scale": controller.speed_scale,
                "controller_base_width": controller.command_base_width,
            }
        )

    def _plant_with(self, controller: dict[str, float]) -> PlantParameters:
        old, robot = self.imperfections, self.robot
        values = {name: getattr(old, name).effective for name in IMPERFECTIONS_OF_PLANT}
        if old.encoder_quantisation.enabled:
            values["encoder_quantisation"] = old.encoder_quantisation.ticks_per_turn
        paper = {name: getattr(robot, name) for name in ROBOT_PARAMETERS}
        return plant_parameters({**paper, **values, **controller, **self.effects})

    @property
    def truth(self) -> dict[str, float]:
        """What a calibration should find: k2_over_k3 (rad/s^2), k1 (s/rad), base_width (m)."""
        return {name: getattr(self.robot, name) for name in ("k2_over_k3", "k1", "base_width")}

    def ideal(self) -> "Settings":
        """Return a copy without effects and imperfections that the paper's model lacks; sensor noise stays."""
        return dataclasses.replace(self, imperfections=self.imperfections.ideal(), effects={})


def load_settings(path: Path | None = None, *, seed: int | None = None, ideal: bool = False) -> Settings:
    """Read settings: those of default.yaml, overridden by the file at `path` and by `seed`.

    `ideal`: those of default.yaml without its effects and imperfections; the file still overrides them. Raises
    SettingsError when the file cannot be read, is not YAML, or holds an unknown key or an impossible value.
    """
    document = read_file(DEFAULT_FILE, SettingsError)
    if ideal:
        values = dataclasses.asdict(structured(document, Settings).ideal())
        document = read(yaml.safe_dump(values), str(DEFAULT_FILE), SettingsError)
    if path is not None:
        document = read_file(path, SettingsError, may_be_empty=True).over(document)
    settings = structured(document, Settings)
    return settings if seed is None else dataclasses.replace(settings, seed=seed)
