"""`robot_<id>.yaml`: the parameters of one robot, validated on reading and written atomically."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TypeVar, cast

from cmr.bus.messages import make, now_utime
from cmr.cli.configuration import LARGEST_ROBOT_ID
from cmr.documents.bounds import Bounds
from cmr.documents.document import DocumentError, Item, quoted, read, read_file
from cmr.files import write_atomically
from cmr.model.laws.law import Law, LawError
from cmr.model.parameters import DEFINITIONS, ParameterDefinition, RobotParameters
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS, NEEDED, VelocityController, motor_of
from cmr.msg import parameters_t
from cmr.parameters.laws import MOST_LAWS, flow, law_content, law_of, learned

SCHEMA = 1
MOTOR = ("k2_over_k3", "k1")  # of robots that take duties; those with a velocity controller have others instead
NO_MAPPING = "it is not a YAML mapping with schema, robot_id and parameters"
COUNTED_WIDTH = "turn_rate_limit_base_width"  # base width used for commands, for the effect that limits turns
KEYS = ("schema", "robot_id", "written", "parameters", "effects", "laws", "provenance")
Part = TypeVar("Part", dict[str, object], list[str])


class ParameterFileError(DocumentError):
    """The parameter file cannot be used; the text says what is wrong, in which line, and what is allowed."""

    between = ": "
    not_yaml = "cannot be read"
    empty = NO_MAPPING
    # The file also comes from the bus. An import of a recording in a thousand pieces has 4,000 values.
    bounds = Bounds(size=256_000, values=20_000, is_simple=True)


@dataclass(frozen=True)
class Value:
    """One parameter's value and, where it was estimated, its standard deviation (same unit)."""

    value: float
    std: float | None = None


@dataclass(frozen=True)
class ParameterFile:
    """The content of a parameter file: the paper's parameters, and those of the effects in use.

    `effects` are the names of the effects in use; each has at least one of its parameters in `values`; missing ones are
    neutral. A parameter of an effect not in use may be present if it is neutral. A robot with a velocity controller has
    the parameters of `cmr.model.velocity_controller` in place of k2_over_k3 and k1. Raises ParameterFileError on
    construction for a contradiction between the two, unknown names, values outside a parameter's range, and invalid
    standard deviations.
    """

    robot_id: int
    values: Mapping[str, Value]
    effects: tuple[str, ...] = ()
    provenance: Mapping[str, object] = field(default_factory=dict)
    written: datetime = field(default_factory=lambda: datetime.now(timezone.utc).replace(microsecond=0))

    def __post_init__(self) -> None:
        if type(self.robot_id) is not int or not 0 <= self.robot_id <= LARGEST_ROBOT_ID:
            raise ParameterFileError(
                f"must be a whole number of 0 to {LARGEST_ROBOT_ID}, not {quoted(self.robot_id)}", "robot_id"
            )
        for name, value in self.values.items():
            _check_value(name, value)
        _check_kind(self.values)
        _check_effects(self.effects, self.values)

    def __getstate__(self) -> dict[str, object]:
        return {"fields": dict(self.__dict__), "laws": self.laws}

    def __setstate__(self, state: Mapping[str, object]) -> None:
        """Register laws in the process that receives the parameters, such as a worker."""
        laws = cast("list[Law]", state["laws"])
        if laws:
            from cmr.model.catalogue import learn

            for law in laws:
                learn(law)
        self.__dict__.update(cast("dict[str, object]", state["fields"]))

    def value(self, name: str) -> float:
        """Return a parameter's value.

        Raises ParameterFileError when the file does not have it.
        """
        try:
            return self.values[name].value
        except KeyError:
            raise ParameterFileError(f"{name} is missing; the file has {', '.join(self.values) or 'none'}") from None

    def has(self, *names: str) -> bool:
        """Return whether the file has all of these parameters."""
        return all(name in self.values for name in names)

    @property
    def has_velocity_controller(self) -> bool:
        """Whether the robot takes speeds, (v, omega) or of its wheels, instead of duties."""
        return any(name in self.values for name in CONTROLLER_DEFINITIONS)

    @property
    def counted_width(self) -> float:
        """The base width [m] that converts (v, omega) to wheel speeds; NaN if unknown."""
        known = (self.value(name) for name in ("command_base_width", "base_width") if self.has(name))
        return next(known, math.nan)

    @property
    def velocity_controller(self) -> VelocityController | None:
        """The velocity controller, which turns (v, omega) and wheel speeds into duties; None for a robot that takes
        duties.

        Raises ParameterFileError naming the first parameter that is missing for it.
        """
        if not self.has_velocity_controller:
            return None
        width = "command_base_width" if self.has("command_base_width") else "base_width"
        return VelocityController(self.value("wheel_radius"), self.value(width), self.value("top_wheel_speed"))

    @property
    def robot_parameters(self) -> RobotParameters:
        """The model's parameters, including those of effects.

        Raises ParameterFileError naming the first of the paper's, or of a velocity controller's, that is missing.
        """
        values = {name: value.value for name, value in self.values.items()}
        if self.has_velocity_controller:
            values |= motor_of({**values, **{name: self.value(name) for name in NEEDED}})
            if COUNTED_WIDTH.removesuffix("_base_width") in values and "command_base_width" in values:
                values.setdefault(COUNTED_WIDTH, values["command_base_width"])
            values = {name: value for name, value in values.items() if name not in CONTROLLER_DEFINITIONS}
        for name in DEFINITIONS:
            if name not in values:
                self.value(name)  # raises the error
        return RobotParameters.of(values)

    def to_yaml(self) -> str:
        """Return the text of the file."""
        entries = {
            name: {"value": value.value, "unit": _definition(name).unit}
            | ({} if value.std is None else {"std": value.std})
            for name, value in self.values.items()
        }
        written = self.written.astimezone(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
        lines = [f"schema: {SCHEMA}", f"robot_id: {self.robot_id}", f"written: {written}", "parameters:"]
        lines += [f"  {name}: {flow(entry)}" for name, entry in entries.items()] or ["  {}"]
        lines.append(f"effects: {flow(list(self.effects))}")
        laws = self.laws
        if laws:
            lines += ["laws:", *(f"  {law.name}: {flow(law_content(law))}" for law in laws)]
        lines.append(f"provenance: {flow(dict(self.provenance))}")
        return "\n".join(lines) + "\n"

    @property
    def laws(self) -> list[Law]:
        """The laws among the effects in use, with this robot's constants."""
        if not self.effects:
            return []
        from cmr.model.catalogue import LAWS

        found = [LAWS[name] for name in self.effects if name in LAWS]
        return [replace(law, constants={name: self._constant(law, name) for name in law.constants}) for law in found]

    def _constant(self, law: Law, name: str) -> float:
        parameter = law.parameter_of(name)
        return self.values[parameter].value if parameter in self.values else law.constants[name]

    def announcement(self, sequence: int) -> parameters_t:
        """Return the parameters_t message that announces this file; `sequence` is its version, larger is newer."""
        return announcement(self.robot_id, self.to_yaml(), sequence)

    def save(self, path: Path) -> None:
        """Write the file atomically: a reader, or a crash at any moment, finds either the old file or the new one.

        Raises OSError when the folder cannot be written.
        """
        write_atomically(self.to_yaml(), path)


def parse(text: str, source: str = "parameter file") -> ParameterFile:
    """Return the parameters in the text of a parameter file; `source` names it in errors.

    Raises ParameterFileError saying what is wrong and where.
    """
    return _parsed(read(text, source, ParameterFileError))


def _parsed(root: Item) -> ParameterFile:
    """Parse a document, validated as plain values; errors are then located in the document."""
    content = root.value
    if not isinstance(content, dict):
        raise root.place.error(NO_MAPPING)
    root.check_keys()
    try:
        if content.get("schema") != SCHEMA:
            raise ParameterFileError(
                f"schema is {quoted(content.get('schema'))}; this version reads schema {SCHEMA}", inside=("schema",)
            )
        unknown = set(content) - {*KEYS}
        if unknown:
            key = min(map(str, unknown))
            raise ParameterFileError(f"unknown key {quoted(key)}", inside=(key,))
        laws = _parse_laws(content)
        if not laws:
            return _checked(content, {})
        with learned(laws):  # an invalid file leaves no laws behind
            return _checked(content, laws)
    except LawError as error:
        raise ParameterFileError(str(error), "laws", *error.within).placed(root) from None
    except ParameterFileError as error:
        raise error.placed(root) from None


def _checked(content: Mapping[str, object], laws: Mapping[str, Law]) -> ParameterFile:
    """Validate a document's plain values; constants come from `laws` unless given."""
    robot_id = cast(int, content.get("robot_id"))  # possibly of the wrong type: ParameterFile reports it
    values = _parse_values(content.get("parameters"))
    effects = tuple(_part(content, "effects", list))
    for law in laws.values():
        for name, value in law.constants.items() if law.name in effects else ():
            values.setdefault(law.parameter_of(name), Value(float(value)))
    return ParameterFile(
        robot_id=robot_id,
        values=values,
        effects=effects,
        provenance=_part(content, "provenance", dict),
        written=_parse_time(content.get("written")),
    )


def _parse_laws(content: Mapping[str, object]) -> dict[str, Law]:
    """Return the laws of a file by name."""
    entries = _part(content, "laws", dict)
    if len(entries) > MOST_LAWS:
        raise ParameterFileError(f"a robot has at most {MOST_LAWS} laws, not {len(entries)}", "laws")
    laws = {}
    for name, entry in entries.items():
        try:
            laws[name] = law_of(name, entry)
        except LawError as error:
            raise ParameterFileError(str(error), "laws", str(name), *error.within) from None
    return laws


def load(path: Path) -> ParameterFile:
    """Read a parameter file.

    Raises ParameterFileError when it is missing, unreadable or wrong.
    """
    return _parsed(read_file(path, ParameterFileError))


def announcement(robot_id: int, text: str, sequence: int) -> parameters_t:
    """Return the parameters_t message that announces a parameter file's text as version `sequence`."""
    return make(
        parameters_t, utime=now_utime(), robot_id=robot_id, sequence=sequence, sha256=sha256_of(text), yaml=text
    )


def sha256_of(text: str) -> str:
    """Return the SHA-256 of a file's text, in hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def _part(content: Mapping[str, object], key: str, kind: type[Part]) -> Part:
    """Return a part that may be missing or empty."""
    part = content.get(key) or kind()
    if not isinstance(part, kind):
        raise ParameterFileError(f"must be a {'mapping' if kind is dict else 'list'}, not {quoted(part)}", key)
    return part


def _parse_values(entries: object) -> dict[str, Value]:
    if not isinstance(entries, dict):
        raise ParameterFileError("must be a mapping of names to {value, unit, std}", "parameters")
    values = {}
    for name, entry in entries.items():
        definition = _definition(name)
        if not isinstance(entry, dict) or "value" not in entry or not set(entry) <= {"value", "unit", "std"}:
            raise ParameterFileError(f"must be {{value: number, unit: {definition.unit}}}", "parameters", name)
        if entry.get("unit", definition.unit) != definition.unit:
            raise ParameterFileError(
                f"unit is {quoted(entry['unit'])}, must be {definition.unit!r}", "parameters", name
            )
        values[name] = Value(entry["value"], entry.get("std"))
    return values


def _parse_time(written: object) -> datetime:
    if isinstance(written, str):
        try:
            written = datetime.fromisoformat(written.replace("Z", "+00:00"))
        except ValueError as error:
            raise ParameterFileError(f"cannot be read: {error}", "written") from error
    if not isinstance(written, datetime):
        raise ParameterFileError(f"must be a time such as 2026-01-31T12:00:00Z, not {quoted(written)}", "written")
    return written if written.tzinfo else written.replace(tzinfo=timezone.utc)


def _definition(name: str) -> ParameterDefinition:
    """Return the definition of a parameter.

    Raises ParameterFileError listing the known names when there is no such parameter.
    """
    for definitions in (DEFINITIONS, CONTROLLER_DEFINITIONS):
        if name in definitions:
            return definitions[name]
    # Files of the paper's model do not need the catalogue, which is slow to load.
    from cmr.model import catalogue

    try:
        return catalogue.DEFINITIONS[name]
    except KeyError:
        known = ", ".join((*catalogue.DEFINITIONS, *CONTROLLER_DEFINITIONS))
        raise ParameterFileError(
            f"unknown name {quoted(name)}; known are {known}", "parameters", inside=(str(name),)
        ) from None


def _check_kind(values: Mapping[str, Value]) -> None:
    """Raise ParameterFileError if a robot has parameters for both duties and speeds."""
    of_motor, of_controller = ([name for name in names if name in values] for names in (MOTOR, CONTROLLER_DEFINITIONS))
    if of_motor and of_controller:
        raise ParameterFileError(
            f"{', '.join(of_motor)} belongs to motors that take duties, {', '.join(of_controller)} to a "
            "velocity controller inside of the robot; a robot has one or the other",
            "parameters",
        )


def _check_effects(effects: tuple[str, ...], values: Mapping[str, Value]) -> None:
    """Raise ParameterFileError unless the effects are known and match those switched on by the values."""
    if not effects and set(values) <= {*DEFINITIONS, *CONTROLLER_DEFINITIONS}:
        return
    from cmr.model.catalogue import MODELLED

    for name in effects:
        if not isinstance(name, str) or name not in MODELLED:
            raise ParameterFileError(f"unknown effect {quoted(name)}; known are {', '.join(MODELLED)}", "effects")
        if effects.count(name) > 1:
            raise ParameterFileError(f"{name} is there more than once", "effects")
    for name, effect in MODELLED.items():
        given = [parameter for parameter in effect.parameters if parameter.name in values]
        if name in effects and not given:
            names = ", ".join(parameter.name for parameter in effect.parameters)
            raise ParameterFileError(f"{name} is in use, but parameters lacks {names}", "effects")
        for parameter in given:
            if name not in effects and not parameter.is_neutral(values[parameter.name].value):
                raise ParameterFileError(
                    f"belongs to the effect {name}, which effects does not name; add it there, or take the parameter "
                    "out",
                    "parameters",
                    parameter.name,
                )


def _check_value(name: str, value: Value) -> None:
    definition = _definition(name)
    if not _is_number(value.value) or not definition.allows(value.value):
        raise ParameterFileError(
            f"value is {quoted(value.value)}, must be a number between {definition.lower:g} and {definition.upper:g} "
            f"{definition.unit}",
            "parameters",
            name,
        )
    if value.std is not None and not (_is_number(value.std) and 0.0 <= value.std < math.inf):
        raise ParameterFileError(f"std is {quoted(value.std)}, must be a number of 0 or more", "parameters", name)


def _is_number(value: object) -> bool:
    """Return whether a value is a number that fits in a float; infinity is allowed."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return False
    try:
        return not math.isnan(value)
    except OverflowError:  # a whole number larger than any float
        return False
