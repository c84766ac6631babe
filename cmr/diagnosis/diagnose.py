"""Find out what the paper's model gets wrong about a robot, and why."""

from collections.abc import Callable, Sequence

from cmr.diagnosis.result import Diagnosis
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording


def diagnose(
    recordings: Recording | Sequence[Recording],
    nominal: ParameterFile | None = None,
    *,
    held_out: Sequence[Recording] = (),
    sources: Sequence[str] = (),
    progress: Callable[[str], None] = lambda sentence: None,
) -> Diagnosis:
    """Diagnose one robot from one or more of its recordings.

    `nominal` gives at least wheel_radius; by default it is what the first recording announces. On `held_out` the gain
    is measured, and nothing is fitted. `progress` is told, in a sentence, what is being done.
    Raises CalibrationError when the paper's model cannot be fitted for a reason other than bad data.
    """
    raise NotImplementedError
