"""What calibration and diagnosis find fault with in a recording."""

from cmr.calibration.preparing import prepare
from cmr.estimation.checks import looked_at, refusal
from cmr.estimation.commanded_speeds import as_duties, controller_of
from cmr.recordings.checks import check
from cmr.recordings.recording import Recording


def complaints(recording: Recording) -> dict[str, str]:
    """Return what calibration and diagnosis find fault with in a recording: a sentence by check, refusal or note."""
    assert recording.parameters is not None
    recording = as_duties(recording, controller_of([recording], recording.parameters))
    found = {finding.check: finding.sentence for finding in check(recording).all if finding.found}
    (looked,) = looked_at([recording])
    prepared = prepare([recording])
    told = {
        "note": looked.note,
        "useless": looked.useless,
        "refusal": refusal([looked]),
        "commands moved": f"{prepared.commands_shifted:.3f} s" if prepared.commands_shifted else "",
    }
    return found | {name: sentence for name, sentence in told.items() if sentence}
