"""cmr-export: take a calibrated robot to another simulator, or to a robot description."""

import argparse
from pathlib import Path
from typing import cast

from cmr.cli.command_line import add_json, check_writable, parse_number, parser, print_json
from cmr.cli.errors import CommandError
from cmr.estimation.estimates import EstimationError
from cmr.exporting.carried import TARGETS, of_robot, what_is_carried
from cmr.exporting.export import Description, export, name_of_file
from cmr.exporting.robot import ExportedRobot, exported
from cmr.files import write_atomically
from cmr.parameters.file import load


def main(arguments: list[str]) -> int:
    """Run cmr-export.

    Raises CommandError if the robot cannot be exported, ParameterFileError if its file cannot be used.
    """
    options = command_parser().parse_args(arguments)
    if options.prove:
        from cmr.exporting.proof import check_provable  # imports that only proofs need

        check_provable(options.to)
    robot = exported(load(options.parameters), options.mass)
    path = options.out or Path(name_of_file(robot, options.to))
    check_writable(path.parent)
    remarks = export(robot, options.to, path, Description(options.wheel_separation, options.wheel_radius))
    proof = _proven(robot, options.to, path, options.parameters) if options.prove else None
    if options.json:
        carried = {
            name: {"carried": one.how.value, "why": one.why} for name, one in of_robot(options.to, robot).items()
        }
        print_json({"file": str(path), "target": options.to, "effects": carried, "remarks": remarks, "proof": proof})
        return _code(proof)
    print("\n".join([*what_is_carried(options.to, robot), *remarks, f"written: {path}"]))
    if proof:
        found = cast("dict[str, object]", proof["diagnosis"])
        print(proof["verdict"])
        print(f"Diagnosed as if it were a real robot: {found['sentence']}")
        print(f"written: {proof['page']}")
    return _code(proof)


def _code(proof: dict[str, object] | None) -> int:
    return 0 if proof is None or proof["holds"] else 1


def _proven(robot: ExportedRobot, target: str, path: Path, parameters: Path) -> dict[str, object]:
    """Run the written file and CMR's own model on the same drive, diagnose it, and write a page about it."""
    from cmr.exporting.departures import departures
    from cmr.exporting.proof import prove
    from cmr.exporting.proof_page import proof_page, verdict

    proof = prove(robot, target, path)
    try:
        diagnosis = departures(proof, robot, load(parameters), parameters)
    except EstimationError as error:
        raise CommandError(f"The drive of the exported robot cannot be diagnosed: {error}") from error
    page = path.with_name(f"{path.name}.html")
    write_atomically(proof_page(robot, proof, diagnosis), page)
    sizes = {"largest_distance": proof.off, "lost": proof.lost, "path_length": proof.length}
    departing = [one.name for one in diagnosis.effects]
    found = {"verdict": diagnosis.verdict, "sentence": diagnosis.sentence, "departing": departing}
    return {"verdict": verdict(proof), "holds": proof.holds, "page": str(page), **sizes, "diagnosis": found}


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-export."""
    result = parser(
        "cmr-export",
        "Write a calibrated robot for another program: a Python file or a functional mock-up unit (FMI 3.0) that step "
        "the same equations, a MuJoCo model, parameters of ROS 2's diff_drive_controller, or Gazebo's systems for "
        "an SDF or a URDF. It says which effects the target carries exactly, which approximately, and which not.",
        "cmr-export robot_0.yaml --to python\n"
        "  cmr-export robot_0.yaml --to ros2_control --wheel-separation 0.16 --wheel-radius 0.033",
    )
    result.add_argument("parameters", type=Path, metavar="ROBOT.yaml", help="parameter file of the robot")
    result.add_argument("--to", required=True, choices=TARGETS, help="what to write")
    result.add_argument(
        "--out", type=Path, metavar="FILE", help="file to write (default: robot_N and the target's ending)"
    )
    of_description = (
        "as the robot description has it, for ros2_control, sdf and urdf "
        "(default: that of the robot's own controller) [m]"
    )
    result.add_argument("--wheel-separation", type=_length, metavar="M", help=f"wheel separation {of_description}")
    result.add_argument("--wheel-radius", type=_length, metavar="M", help=f"wheel radius {of_description}")
    result.add_argument(
        "--mass",
        type=_mass,
        metavar="KG",
        help="mass of the robot, for sdf and urdf: without it, wheels do not slip in Gazebo [kg]",
    )
    result.add_argument(
        "--prove",
        action="store_true",
        help="run the file (python, fmu, mjcf), compare it with CMR's own model, and write FILE.html with the results",
    )
    add_json(result)
    return result


def _length(text: str) -> float:
    return parse_number(text, f"{text!r} is not a length: a number greater than 0, in m", above=0.0)


def _mass(text: str) -> float:
    return parse_number(text, f"{text!r} is not a mass: a number greater than 0, in kg", above=0.0)
