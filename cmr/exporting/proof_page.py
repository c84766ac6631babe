"""The page of a proof: both paths, and what the export lost."""

from collections.abc import Mapping

import numpy as np

from cmr.diagnosis.result import Diagnosis
from cmr.exporting.carried import FMU, MJCF, PYTHON, Carried, Carry, effects_table, of_robot
from cmr.exporting.proof import SAME, SECONDS, Proof
from cmr.exporting.robot import ExportedRobot
from cmr.report.keys import keys, real_key, simulated_key
from cmr.report.markup import Html, tag
from cmr.report.numbers import number
from cmr.report.page import page_of
from cmr.report.section import code, paragraph, quiet, section
from cmr.report.style import AFTER, REAL, REAL_OUTLINE
from cmr.report.svg import Frame, line, plot
from cmr.report.table import table

MARGIN = 0.1  # m around the paths
PROGRAM = {PYTHON: "Python", FMU: "an FMU", MJCF: "MuJoCo"}  # where a target is run


def verdict(proof: Proof) -> str:
    """Return in a sentence whether the exported robot moves as the calibrated one."""
    share = f"{100.0 * proof.off / proof.length:.2f} % of the path's {proof.length:.1f} m"
    if not proof.holds:
        return (
            f"The exported robot is up to {proof.off:.3g} m off ({share}), more than the effects that it lacks explain."
        )
    if proof.off <= SAME:
        return f"The exported robot drives the same path: within {proof.off:.1g} m over {SECONDS:.0f} s."
    lost = f", of which {proof.lost:.3g} m are due to effects that it does not carry" if proof.lost > SAME else ""
    return f"The exported robot is up to {proof.off:.3g} m off within {SECONDS:.0f} s, {share}{lost}."


def proof_page(robot: ExportedRobot, proof: Proof, diagnosis: Diagnosis) -> str:
    """Return the page."""
    found = of_robot(proof.target, robot)
    program = PROGRAM[proof.target]
    title = f"Robot {robot.robot_id} in {program}"
    header = tag("header", tag("h1", title), paragraph(verdict(proof)))
    sections = [
        section("Both paths", _paths(proof), keys(real_key("CMR"), simulated_key(program))),
        section("Deviation", _numbers(proof)),
        section("Diagnosed as if it were a real robot", *_departures(proof, diagnosis, found)),
        section("What the export carries", effects_table(proof.target, robot)),
    ]
    lead = quiet(
        f"The drive of {SECONDS:.0f} s is no recording, so nothing was fitted to it: curves both ways, reversals and "
        "rests. CMR's own model drives it, and the file that was written, in the program that it is for."
    )
    return page_of(title, header, lead, sections)


def _paths(proof: Proof) -> Html:
    both = np.concatenate([proof.expected[:, :2], proof.found[:, :2]])
    low, high = both.min(axis=0) - MARGIN, both.max(axis=0) + MARGIN
    half, middle = float(np.max(high - low)) / 2.0, (low + high) / 2.0
    frame = Frame(
        x=(float(middle[0]) - half, float(middle[0]) + half),
        y=(float(middle[1]) - half, float(middle[1]) + half),
        height=360.0,
    )
    return plot(
        frame,
        line(frame, proof.expected[:, 0], proof.expected[:, 1], REAL, 4.0, under=REAL_OUTLINE),
        line(frame, proof.found[:, 0], proof.found[:, 1], AFTER, 1.8),
        x_label="x [m]",
        y_label="y [m]",
        alt=f"the path of CMR's robot and that of the exported one; {verdict(proof)}",
    )


def _numbers(proof: Proof) -> Html:
    heading = float(np.max(np.abs(proof.found[:, 2] - proof.expected[:, 2])))
    rows = [
        ["largest distance between the paths", number(proof.off), "m"],
        ["distance at the end", number(float(np.hypot(*(proof.found[-1, :2] - proof.expected[-1, :2])))), "m"],
        ["largest difference of headings", number(heading), "rad"],
        ["the largest that effects which are not carried make", number(proof.lost), "m"],
        ["largest distance to a robot with the carried effects alone", number(proof.off_of_carried), "m"],
        ["length of the path", number(proof.length), "m"],
    ]
    return table(["what", "size", "unit"], rows, numbers=[1])


def _departures(proof: Proof, diagnosis: Diagnosis, carried: Mapping[str, Carried]) -> list[Html]:
    """Return the departures from the parameter file that a diagnosis names, and the effects that the target does not
    carry.
    """
    drive = quiet(
        f"The same drive of {SECONDS:.0f} s as encoders, a gyro and a tracker with the usual noise say it, diagnosed "
        "against the parameter file that was exported, as ",
        code("cmr-diagnose --against"),
        " does.",
    )
    against = diagnosis.against
    assert against is not None
    rows = [
        [one.name, one.cause, "not carried" if _is_lost(carried.get(one.name)) else ""] for one in diagnosis.effects
    ]
    rows += [[one.name, f"{one.estimate.value:.4g}, in the file {one.given:.4g}", ""] for one in against.departures]
    headings = ["what departs", "how", f"by {PROGRAM[proof.target]}"]
    return [paragraph(diagnosis.sentence), *([table(headings, rows)] if rows else []), drive]


def _is_lost(one: Carried | None) -> bool:
    return one is not None and one.how is Carry.NOT
