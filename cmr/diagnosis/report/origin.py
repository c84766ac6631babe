"""Where it all comes from: what was wrong with the data, and what was diagnosed with what."""

from importlib.metadata import version

from cmr.diagnosis.report.markup import Html, joined
from cmr.diagnosis.report.section import bullets, code, codes, paragraph, quiet, section
from cmr.diagnosis.report.table import table
from cmr.diagnosis.result import BAD_DATA, Diagnosis


def data(diagnosis: Diagnosis) -> Html:
    """Return what was wrong with the data, in sentences, how late commands were, and which checks found nothing."""
    faults = [[code(check.check), f"{check.found:,}", check.sentence] for check in diagnosis.checks if check.found]
    clean = tuple(check.check for check in diagnosis.checks if not check.found)
    late = joined(*map(paragraph, diagnosis.lateness_sentences))
    listed = quiet(f"{len(clean)} checks found nothing: ", codes(clean), ".") if clean else Html("")
    if not faults:
        sound = diagnosis.verdict != BAD_DATA
        told = "No check of the data found a fault." if sound else "Why they cannot be used stands at the top."
        words = paragraph(told) if clean else Html("")
        return section("The data", words, late, listed)
    return section("The data", table(("check", "found", "what it means"), faults, numbers=(1,)), late, listed)


def provenance(diagnosis: Diagnosis) -> Html:
    """Return sources, amount of data and version."""
    sources = bullets([code(source) for source in diagnosis.sources])
    amount = f"{diagnosis.samples:,} measurements" if diagnosis.samples else "no usable measurement"
    said = paragraph(
        f"Diagnosis of robot {diagnosis.robot_id} by CMR {version('cmr')} from {amount}",
        " in these recordings:" if diagnosis.sources else ".",
    )
    model = quiet(
        "The paper's model is that of Edwards, Gaskell and Olson, AAMAS 2018: K2/K3, K1 and base width, from commands "
        "to path. The equations of all effects stand in docs/effects.md."
    )
    return section("Provenance", joined(said, sources, model))
