"""The robot to export, from its parameter file, in the form that targets need."""

from dataclasses import dataclass
from functools import cached_property

from cmr.model.command_kinds import DUTY, VELOCITY
from cmr.model.effect import LAWS, Effect
from cmr.model.extended.program import Constant, Program, program_of
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import VelocityController
from cmr.parameters.file import ParameterFile


@dataclass(frozen=True)
class ExportedRobot:
    """One robot with its parameters; `controller` is None if it takes duties.

    `mass` [kg] cannot be estimated from motion: None if it is not known.
    """

    robot_id: int
    parameters: RobotParameters
    controller: VelocityController | None = None
    mass: float | None = None

    @property
    def takes(self) -> str:
        """The commands that the robot takes: DUTY or VELOCITY."""
        return DUTY if self.controller is None else VELOCITY

    @cached_property
    def program(self) -> Program:
        """The statements of the robot's model."""
        return program_of(self.parameters)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects that are on."""
        return self.program.effects

    @property
    def constants(self) -> dict[str, Constant]:
        """The constants that statements read, by name; laws of sensors have no statements, so theirs are not
        included.
        """
        left_out = [effect for effect in self.effects if effect.group == LAWS and effect.is_sensor]
        names = {parameter.name for effect in left_out for parameter in effect.all_parameters}
        return {name: one for name, one in self.program.constants.items() if name not in names}

    def value(self, name: str) -> float:
        """Return a parameter's value; that of an effect that is off is neutral."""
        from cmr.model.catalogue import definition

        neutral = definition(name).neutral
        return float(self.parameters.values.get(name, 0.0 if neutral is None else neutral))

    @property
    def sentences(self) -> list[str]:
        """A sentence for each effect that is on, with its size."""
        values = {name: constant.value for name, constant in self.program.constants.items()}
        if self.controller is None:
            return [effect.sentence(values) for effect in self.effects]
        top, gain = self.controller.top_wheel_speed, values["k2_over_k3"]
        return [effect.sentence_of_speed(values, top, gain) for effect in self.effects]


def exported(file: ParameterFile, mass: float | None = None) -> ExportedRobot:
    """Return the robot of a parameter file, with its mass [kg] if that is known.

    Raises ParameterFileError naming the first parameter that a simulation needs and that is missing.
    """
    return ExportedRobot(file.robot_id, file.robot_parameters, file.velocity_controller, mass)
