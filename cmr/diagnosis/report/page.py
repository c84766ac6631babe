"""The whole page: one self-contained file, ordered by importance."""

from pathlib import Path

from cmr.diagnosis.report import found, improvement, laws, measured, origin
from cmr.diagnosis.report.decisions import decisions
from cmr.diagnosis.report.pairs import pairs_of
from cmr.diagnosis.result import BAD_DATA, Diagnosis
from cmr.files import write_atomically
from cmr.report.page import page_of
from cmr.report.section import Section


def report_of(diagnosis: Diagnosis) -> str:
    """Return the report as a self-contained HTML page."""
    title = f"Diagnosis of robot {diagnosis.robot_id}: {found.BADGES.get(diagnosis.verdict, diagnosis.verdict)}"
    return page_of(title, found.header(diagnosis), found.key_numbers(diagnosis), _sections(diagnosis))


def write_report(diagnosis: Diagnosis, path: Path) -> None:
    """Write the report to a file, atomically.

    Raises OSError when it cannot be written.
    """
    write_atomically(report_of(diagnosis), path)


def _sections(diagnosis: Diagnosis) -> list[Section]:
    """Return all sections, some empty; with bad data, its problems come first."""
    pairs = pairs_of(diagnosis.evidence.residuals)
    data, next_steps = origin.data(diagnosis), found.next_steps(diagnosis)
    spoilt = diagnosis.verdict == BAD_DATA
    return [
        *((data, next_steps) if spoilt else ()),
        found.named(diagnosis),
        measured.paths(diagnosis),
        laws.laws(diagnosis),
        found.tell_tales(diagnosis, pairs),
        improvement.gain(diagnosis),
        found.runners_up(diagnosis),
        decisions(diagnosis),
        measured.remains(diagnosis, pairs),
        *(() if spoilt else (data, next_steps)),
        measured.parameters(diagnosis),
        measured.residuals(diagnosis, pairs),
        origin.provenance(diagnosis),
    ]
