"""`cmr-export --to fmu`: a functional mock-up unit (FMI 3.0, co-simulation) with the robot's C sources and a binary."""

import hashlib
import platform
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from collections.abc import Mapping
from html import escape
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from cmr.exporting.c_source import HEADER, TEMPLATE, c_header, c_source, shipped
from cmr.exporting.c_statements import number
from cmr.exporting.carried import effects_table, what_is_carried
from cmr.exporting.python_statements import filled
from cmr.exporting.robot import ExportedRobot
from cmr.report.markup import tag
from cmr.report.page import page_of

WRAPPER = "fmi3_robot.c"
SOURCES = (TEMPLATE, WRAPPER)
OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-fvisibility=hidden", "-shared")
PLATFORMS = {("Linux", "x86_64"): "x86_64-linux", ("Linux", "aarch64"): "aarch64-linux"}
EPOCH = (1980, 1, 1, 0, 0, 0)  # of all entries: the same robot gives the same file
STEP_SIZE = 0.01  # s, unless the importer chooses
NO_COMPILER = (
    "There is no C compiler (cc) here, so the FMU has sources and no binary. Install one and export again "
    "(Debian, Ubuntu: apt install gcc), or add the binary on a computer that has a compiler, CMake and FMPy: "
    "python3 -m fmpy compile {path}"
)


class Variable(NamedTuple):
    """A variable of the unit."""

    name: str
    unit: str
    description: str


DUTIES = (
    Variable("duty_left", "1", "command of the left side, -1 to 1"),
    Variable("duty_right", "1", "command of the right side, -1 to 1"),
)
VELOCITIES = (
    Variable("v", "m/s", "commanded speed"),
    Variable("omega", "rad/s", "commanded turn rate, counter-clockwise"),
)
STARTS = (
    Variable("start_x", "m", "where the robot starts"),
    Variable("start_y", "m", "where the robot starts"),
    Variable("start_theta", "rad", "its heading there, counter-clockwise from x"),
)
OUTPUTS = (
    Variable("x", "m", "turning centre of the robot"),
    Variable("y", "m", "turning centre of the robot"),
    Variable("theta", "rad", "heading, counter-clockwise from x, not wrapped"),
    Variable("wheel_speed_left", "rad/s", "speed of the left wheels"),
    Variable("wheel_speed_right", "rad/s", "speed of the right wheels"),
    Variable("wheel_angle_left", "rad", "how far the left wheels have turned"),
    Variable("wheel_angle_right", "rad", "how far the right wheels have turned"),
    Variable("encoder_left", "rad", "wheel angle by the encoder"),
    Variable("encoder_right", "rad", "wheel angle by the encoder"),
    Variable("gyro_yaw_rate", "rad/s", "yaw rate by the gyro"),
    Variable("tracked_x", "m", "pose by the tracker"),
    Variable("tracked_y", "m", "pose by the tracker"),
    Variable("tracked_theta", "rad", "heading by the tracker"),
)


class Unit(NamedTuple):
    """The bytes of an FMU, and whether it has a binary for this computer."""

    content: bytes
    has_binary: bool


def fmu(robot: ExportedRobot, compiler: str | None = None) -> Unit:
    """Return the FMU of a robot; `compiler` is the C compiler, by default the `cc` that is found.

    Raises subprocess.CalledProcessError with the output of the compiler, if it fails.
    """
    name = f"robot_{robot.robot_id}"
    files = {HEADER: c_header(robot), TEMPLATE: c_source(robot), WRAPPER: shipped(WRAPPER)}
    token = str(uuid.UUID(hashlib.sha256(repr((files, _numbers(robot))).encode()).hexdigest()[:32]))
    files[WRAPPER] = filled(files[WRAPPER], {"CONFIGURATION": _configuration(robot, token)})
    entries: dict[str, str | bytes] = {
        "modelDescription.xml": _description(robot, name, token),
        "documentation/index.html": _documentation(robot, name),
        "sources/buildDescription.xml": _build_description(name),
        **{f"sources/{file}": text for file, text in files.items()},
    }
    tuple_of_platform = PLATFORMS.get((platform.system(), platform.machine()))
    compiler = compiler or shutil.which("cc")
    has_binary = bool(compiler and tuple_of_platform)
    if compiler and tuple_of_platform:
        entries[f"binaries/{tuple_of_platform}/{name}.so"] = _compiled(files, compiler)
    return Unit(_zipped(entries), has_binary)


def inputs_of(robot: ExportedRobot) -> tuple[Variable, ...]:
    """Return the inputs of the unit."""
    return DUTIES if robot.controller is None else VELOCITIES


def _numbers(robot: ExportedRobot) -> dict[str, float]:
    if robot.controller is None:
        return {}
    return {
        "TOP_WHEEL_SPEED": robot.controller.top_wheel_speed,
        "COMMAND_WHEEL_RADIUS": robot.controller.wheel_radius,
        "COMMAND_BASE_WIDTH": robot.controller.base_width,
    }


def _configuration(robot: ExportedRobot, token: str) -> str:
    lines = [f'#define TOKEN "{token}"', *(f"#define {name} {number(one)}" for name, one in _numbers(robot).items())]
    return "\n".join(lines) + "\n"


def _compiled(files: Mapping[str, str], compiler: str) -> bytes:
    with tempfile.TemporaryDirectory(prefix="cmr-export-") as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        command = [compiler, *OPTIONS, "-o", "unit.so", *SOURCES, "-lm"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
        return (folder / "unit.so").read_bytes()


def _zipped(entries: Mapping[str, str | bytes]) -> bytes:
    content = BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries.items():
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, data)
    return content.getvalue()


def _description(robot: ExportedRobot, name: str, token: str) -> str:
    variables = _variables(robot)
    references = range(len(variables) - len(OUTPUTS), len(variables))  # of the outputs
    units = dict.fromkeys(one.unit for one in (*inputs_of(robot), *STARTS, *OUTPUTS))
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{token}"',
            f'    description="{escape(" ".join(what_is_carried("fmu", robot)))}"',
            '    generationTool="Calibrated Mixed Reality" variableNamingConvention="flat">',
            f'  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"',
            f'      fixedInternalStepSize="{STEP_SIZE}"/>',
            "  <UnitDefinitions>",
            *(_unit(one) for one in (*units, "s")),
            "  </UnitDefinitions>",
            f'  <DefaultExperiment startTime="0.0" stopTime="60.0" stepSize="{STEP_SIZE}"/>',
            "  <ModelVariables>",
            *variables,
            "  </ModelVariables>",
            "  <ModelStructure>",
            *(f'    <Output valueReference="{reference}"/>' for reference in references),
            *(f'    <InitialUnknown valueReference="{reference}"/>' for reference in references),
            "  </ModelStructure>",
            "</fmiModelDescription>",
            "",
        ]
    )


def _variables(robot: ExportedRobot) -> list[str]:
    """Return the elements of all variables, the outputs last; the value reference of each is its index."""
    seed = Variable("seed", "", "fixes the random numbers of late and lost commands")
    rows = [("Float64", Variable("time", "s", "time"), 'causality="independent" variability="continuous"')]
    rows += [("Float64", one, 'causality="input" variability="continuous" start="0.0"') for one in inputs_of(robot)]
    rows += [("Float64", one, 'causality="parameter" variability="fixed" start="0.0"') for one in STARTS]
    rows += [("UInt64", seed, 'causality="parameter" variability="fixed" start="0"')]
    rows += [("Float64", one, 'causality="output" variability="continuous" initial="calculated"') for one in OUTPUTS]
    return [_variable(kind, number, variable, rest) for number, (kind, variable, rest) in enumerate(rows)]


def _variable(kind: str, reference: int, variable: Variable, rest: str) -> str:
    unit = f' unit="{variable.unit}"' if variable.unit else ""
    return (
        f'    <{kind} name="{variable.name}" valueReference="{reference}"{unit} '
        f'description="{escape(variable.description)}" {rest}/>'
    )


def _unit(name: str) -> str:
    exponents = {"m": 'm="1"', "m/s": 'm="1" s="-1"', "rad": 'rad="1"', "rad/s": 'rad="1" s="-1"', "s": 's="1"'}
    return f'    <Unit name="{name}"><BaseUnit {exponents.get(name, "")}/></Unit>'


def _build_description(name: str) -> str:
    files = "".join(f'      <SourceFile name="{file}"/>\n' for file in SOURCES)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{name}">\n'
        f'    <SourceFileSet language="C99">\n{files}    </SourceFileSet>\n'
        '    <Library name="m" external="true"/>\n'
        "  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def _documentation(robot: ExportedRobot, name: str) -> str:
    return page_of(name, tag("header", tag("h1", name)), effects_table("fmu", robot), [])
