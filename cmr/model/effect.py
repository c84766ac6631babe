"""An effect: one entry used by simulation, calibration, diagnosis, report and documentation.

The equation in an entry is the code: Python statements for the stages of `cmr.model.stages`. The model's step is
composed of the statements of all entries, and the documentation prints them.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from cmr.model.command_kinds import KINDS as COMMAND_KINDS
from cmr.model.parameters import KINDS, ParameterDefinition
from cmr.model.stages import STAGES

GROUPS = ("battery and electronics", "motors and gearing", "wheels and ground", "sensors")
GENERIC = "generic terms"  # group of terms without a cause
LAWS = "laws"  # group of formulas found on robots that the catalogue does not fully describe


@dataclass(frozen=True)
class Memory:
    """A value that the robot keeps between steps; 0.0 at the start unless stage `start` sets it.

    A `lasting` value survives a gap in a recording: a battery is as empty after it as before.
    """

    name: str
    unit: str
    meaning: str
    per_side: bool = False
    lasting: bool = False


@dataclass(frozen=True)
class Effect:
    """A physical effect that the paper's model lacks.

    `cause` is a sentence with `{parameter}` fields: `{gyro_bias:.3f}` prints the size, `{gyro_bias:high/low}` the word
    for its sign. `equations` maps stages to statements, see above. `needs` is the motion that reveals the effect,
    `shows_in` the signals, and `confused_with` maps the names of other effects to the manoeuvre that distinguishes
    them. Parameters in `given` are conditions of the effect: they are given, not estimated, and switch nothing on. An
    effect that never occurs alone is tested only `beside` another one, once that was selected. `with_commands` are the
    kinds of commands for which it is detectable: a velocity controller in the robot compensates many effects. With
    commanded speeds it may have another sentence, `cause_of_speed`, in which a duty is a wheel speed in rad/s, and
    `{parameter_acceleration}` the acceleration from rest in rad/s^2. An effect with `lateness_of` a sensor, "poses" or
    "gyro", has one parameter: the additional age of readings [s]. `rarity` is how much more it must reduce the sum of
    squares to be preferred to another effect; to be named at all, twice that. One that is `in_data_sheets` is hardly
    ever wrong: it must explain clearly more than the effect it replaces. An effect `by_chance` is visible in the spread
    of readings, not in their mean, and is not fitted; on average it adds its size, times the number in `on_average`, to
    each parameter named there. The size of one that is `read_off` the data is not fitted either. One `of_one_frame`
    depends on positions or headings in one world frame: it is not detectable if each piece of a recording has its own
    frame. `same_without` maps the names of other effects, or of the paper's parameters, to the readings that
    distinguish the two ("commands", "wheels", "gyro"). An effect of t seconds moves a robot nearly as if each latency
    in `seems_like` were t longer.
    """

    name: str
    group: str
    cause: str
    equations: Mapping[str, str]
    parameters: tuple[ParameterDefinition, ...]
    needs: str
    shows_in: str
    confused_with: Mapping[str, str] = field(default_factory=dict)
    memory: tuple[Memory, ...] = ()
    given: tuple[ParameterDefinition, ...] = ()
    beside: str = ""
    with_commands: tuple[str, ...] = COMMAND_KINDS
    cause_of_speed: str = ""
    lateness_of: str = ""
    rarity: float = 0.0
    in_data_sheets: bool = False
    by_chance: bool = False
    on_average: Mapping[str, float] = field(default_factory=dict)
    read_off: bool = False
    of_one_frame: bool = False
    same_without: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    seems_like: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        groups = (*GROUPS, GENERIC, LAWS)
        if self.group not in groups:
            raise ValueError(f"effect {self.name}: group {self.group!r} is none of {', '.join(groups)}")
        unknown = sorted(set(self.equations) - set(STAGES))
        if unknown:
            raise ValueError(f"effect {self.name}: unknown stages {', '.join(unknown)}; known: {', '.join(STAGES)}")
        for parameter in self.all_parameters:
            if parameter.name != self.name and not parameter.name.startswith(f"{self.name}_"):
                raise ValueError(f"effect {self.name}: parameter {parameter.name} must be called {self.name}_...")
            if parameter.kind not in KINDS:
                raise ValueError(
                    f"effect {self.name}: kind {parameter.kind!r} of {parameter.name} is none of {', '.join(KINDS)}"
                )

    @property
    def all_parameters(self) -> tuple[ParameterDefinition, ...]:
        """The estimated parameters, then the given ones."""
        return (*self.parameters, *self.given)

    @property
    def is_sensor(self) -> bool:
        """Whether the effect changes sensor readings but not the motion."""
        return all(STAGES[stage].of_sensors for stage in self.equations)

    @property
    def is_fitted(self) -> bool:
        """Whether its parameters are fitted, neither estimated by the spread of readings nor read off them."""
        return not (self.by_chance or self.read_off)

    @property
    def locality(self) -> str:
        """Whether it belongs to a "time", to a "place", or to neither ("")."""
        kinds = {parameter.kind for parameter in self.parameters}
        return "place" if {"x", "y", "radius"} <= kinds else "time" if "time" in kinds else ""

    def parameter_of(self, kind: str) -> str:
        """Return the name of its first parameter of a kind."""
        return next(parameter.name for parameter in self.parameters if parameter.kind == kind)

    def same_with(self, recorded: Collection[str]) -> list[str]:
        """Return what nothing distinguishes it from, by name, with only these readings; see `same_without`."""
        return [name for name, readings in self.same_without.items() if not {*readings} & {*recorded}]

    def is_on(self, values: Mapping[str, object]) -> bool:
        """Return whether any of these values, by parameter name, switches the effect on."""
        return any(
            not parameter.is_neutral(values[parameter.name])
            for parameter in self.parameters
            if parameter.switches and parameter.name in values
        )

    def sentence(self, values: Mapping[str, float]) -> str:
        """Return the sentence that names the cause, with these values of the parameters."""
        return self.cause.format(**{parameter.name: _Size(values[parameter.name]) for parameter in self.parameters})

    def sentence_of_speed(self, values: Mapping[str, float], top_wheel_speed: float, acceleration: float) -> str:
        """Return the sentence that names the cause for commanded speeds, with the wheel speed of duty 1 [rad/s].

        `acceleration` [rad/s^2] is that of a wheel at rest with duty 1.
        """
        if not self.cause_of_speed:
            return self.sentence(values)
        sizes = {p.name: values[p.name] * (top_wheel_speed if "duty" in p.unit else 1.0) for p in self.parameters}
        sizes |= {f"{p.name}_acceleration": values[p.name] * acceleration for p in self.parameters}
        return self.cause_of_speed.format(**{name: _Size(value) for name, value in sizes.items()})


class _Size(float):
    """A number formatted as its magnitude, with a plus in the format also its sign, or as one of two words by its
    sign.
    """

    def __format__(self, specification: str) -> str:
        positive, slash, negative = specification.partition("/")
        if slash:
            return negative if self < 0.0 else positive
        return format(float(self) if specification.startswith("+") else abs(float(self)), specification)
