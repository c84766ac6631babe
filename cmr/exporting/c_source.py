"""The robot in C99, from the same statements as the Python file: a header common to all robots, and one robot's
source.
"""

from importlib.resources import files

from cmr.exporting.c_statements import assigned, c_functions, c_lines, declared, number
from cmr.exporting.carried import what_is_carried
from cmr.exporting.python_file import PREPARE, SHORTEST, filter_of, moments
from cmr.exporting.python_statements import called, filled, indented
from cmr.exporting.robot import ExportedRobot
from cmr.model.extended.program import Program, collocation
from cmr.model.extended.step_statements import LONGEST_STEP

HEADER, TEMPLATE = "cmr_robot.h", "cmr_robot.c"
LATE = """\
double delay, lost;
uint64_t seed = moved->seed, count = moved->count++, robot = 0;
(void)dt, (void)seed, (void)count, (void)robot;
PACKET
return arrives(moved, lost != 0.0, moved->time + delay);
"""
PROMPT = """\
(void)moved, (void)dt;
return 1;
"""


def c_header(robot: ExportedRobot) -> str:
    """Return the header of the robot in C."""
    program = robot.program
    return filled(shipped(HEADER), {"MEMORY": indented((f"double {name};" for name in program.memory), 4)})


def c_source(robot: ExportedRobot) -> str:
    """Return the source of the robot in C."""
    program = robot.program
    stages = {name: program.sensors[name] for name in ("encoder", "gyro", "pose")}
    used = called(line for lines in (program.begin, PREPARE, program.step, *stages.values()) for line in lines)
    used |= called(program.packet)
    keep = {name: name for name in program.state} | {"yaw_rate": "yaw_rate_end"}
    parts = {
        "DOCUMENTATION": "".join(f" * {line}\n" for line in what_is_carried("fmu", robot))
        .replace("*/", "* /")
        .replace("/*", "/ *"),
        "CONSTANTS": "".join(f"{line}\n" for line in _constants(robot)),
        "FUNCTIONS": c_functions(used),
        "BEGIN": _inside(program.begin, ("psi_left", "psi_right")),
        "REMEMBER": indented((f"robot->{name} = {name};" for name in program.memory), 4),
        "RECALL": indented((f"double {name} = robot->{name};" for name in program.state), 4),
        "STEP": _inside([*PREPARE, *program.step], ("command_left", "command_right", *program.state)),
        "KEEP": indented((f"robot->{name} = {value};" for name, value in keep.items()), 4),
        "PACKET": indented([filled(LATE, {"PACKET": _inside(program.packet, ("delay", "lost"))})], 4)
        if program.is_late
        else indented([PROMPT], 4),
        "MOMENTS": _inside(moments(program), ("time", "encoder_moment", "gyro_moment", "moment", "filtered")),
        "ENCODER": _inside(stages["encoder"], ("reading_left", "reading_right")),
        "GYRO": _inside(stages["gyro"], ("reading",)),
        "POSE": _inside(stages["pose"], ("x", "y", "theta")),
    }
    return filled(shipped(TEMPLATE), parts)


def _inside(lines: list[str], known: tuple[str, ...]) -> str:
    """Return statements in C, with declarations of the variables that are not known."""
    own = [name for name in assigned(lines) if name not in known]
    return indented((*declared(own), *c_lines(lines)), 4)


def _constants(robot: ExportedRobot) -> list[str]:
    program = robot.program
    lines = [
        f"static const double {name} = {number(one.value)}; /* [{one.definition.unit}] {one.definition.meaning} */"
        for name, one in robot.constants.items()
    ]
    lines += [f"static const double {name} = {number(value)};" for name, value in collocation().items()]
    lines.append(f"#define LATE_COMMANDS {int(program.is_late)}")
    lines += [f"static const double SHORTEST = {number(SHORTEST)}; /* of a step */"] if program.is_late else []
    return [*lines, f"static const double LONGEST_STEP = {number(LONGEST_STEP)}; /* [s] */", *_filter(program)]


def _filter(program: Program) -> list[str]:
    pairs = filter_of(program)
    rows = ", ".join(f"{{{number(age)}, {number(weight)}}}" for age, weight in pairs)
    return [
        "/* Ages of the poses that stand for a smoothed one, in time constants, and their weights. */",
        f"#define POSES {len(pairs)}",
        f"static const double FILTER[POSES][2] = {{{rows}}};",
    ]


def shipped(name: str) -> str:
    """Return a template that comes with this package."""
    return (files("cmr.exporting") / "templates" / name).read_text(encoding="utf-8")
