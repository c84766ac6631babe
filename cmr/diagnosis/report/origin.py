"""Problems in the data, and the recordings and the version behind the diagnosis."""

from cmr.diagnosis.result import BAD_DATA, Diagnosis
from cmr.distribution import version
from cmr.report.markup import Html, joined
from cmr.report.section import Section, bullets, code, codes, paragraph, quiet, section
from cmr.report.table import table


def data(diagnosis: Diagnosis) -> Section:
    """Return the problems of the data, command delays, and the checks without findings."""
    faults = [[code(check.check), f"{check.found:,}", check.sentence] for check in diagnosis.checks if check.found]
    clean = tuple(check.check for check in diagnosis.checks if not check.found)
    late = joined(*map(paragraph, diagnosis.lateness_sentences))
    listed = (
        quiet(f"{len(clean)} {'check' if len(clean) == 1 else 'checks'} found no problem: ", codes(clean), ".")
        if clean
        else Html("")
    )
    if not faults:
        sound = diagnosis.verdict != BAD_DATA
        statement = (
            "No check found a problem in the data."
            if sound
            else "The reason why they cannot be used is at the top of the page."
        )
        words = paragraph(statement) if clean else Html("")
        return section("Data", words, late, listed)
    return section("Data", table(("check", "found", "what it means"), faults, numbers=(1,)), late, listed)


def provenance(diagnosis: Diagnosis) -> Section:
    """Return sources, amount of data and version."""
    sources = bullets([code(source) for source in diagnosis.sources])
    amount = f"{diagnosis.samples:,} measurements" if diagnosis.samples else "no usable measurement"
    said = paragraph(
        f"Diagnosis of robot {diagnosis.robot_id} by CMR {version()} from {amount}",
        " in these recordings:" if diagnosis.sources else ".",
    )
    model = quiet(
        "The paper's model is that of Edwards, Gaskell and Olson, AAMAS 2018: K2/K3, K1 and base width, from commands "
        "to path. The equations of all effects are in docs/effects.md."
    )
    return section("Provenance", joined(said, sources, _against(diagnosis), model))


def _against(diagnosis: Diagnosis) -> Html:
    """Return the parameter file that the robot was compared with; empty without one."""
    against = diagnosis.against
    if against is None:
        return Html("")
    effects = joined("its effects are ", codes(against.effects)) if against.effects else "it has no effects"
    file, digest = code(against.source), code(against.sha256)
    return paragraph("The robot was compared with that of ", file, ", SHA-256 ", digest, "; ", effects, ".")
