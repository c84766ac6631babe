"""Calibrated Mixed Reality: real and virtual robots in one world.

What `import cmr` offers is in `__all__` and is supported, with the entry points for effects and behaviours; packages
are the implementation. ARCHITECTURE.md lists them: imports run one way, from `commands` down to `model` and shared
utilities.

This module imports almost nothing, so that a command handles Ctrl-C before any slow import.
"""

import os
import sys

MESSAGES = "msg"  # the package that the build generates from lcmtypes/


def _generated(folders: list[str]) -> list[str]:
    """Return the folders that contain the generated message classes."""
    return [folder for folder in folders if os.path.isdir(os.path.join(folder, MESSAGES))]  # noqa: PTH112, PTH118


if not _generated(__path__):
    # Python runs inside a checkout, but CMR was installed elsewhere: that installation has the message classes.
    __path__ += _generated([os.path.join(folder, __name__) for folder in sys.path])  # noqa: PTH118


# Type checkers know the name; importing it from typing would take longer than everything else here
TYPE_CHECKING = False
if TYPE_CHECKING:
    from cmr.calibration.calibrate import calibrate
    from cmr.calibration.result import CalibrationResult
    from cmr.diagnosis.diagnose import diagnose
    from cmr.diagnosis.result import Diagnosis
    from cmr.model.effect import Effect
    from cmr.parameters.file import ParameterFile
    from cmr.recordings.recording import Recording
    from cmr.robot_log import RobotLog, read

    __version__: str

# Public names and their modules, which are imported at first use.
_MODULES = {
    "CalibrationResult": "cmr.calibration.result",
    "Diagnosis": "cmr.diagnosis.result",
    "Effect": "cmr.model.effect",
    "ParameterFile": "cmr.parameters.file",
    "Recording": "cmr.recordings.recording",
    "RobotLog": "cmr.robot_log",
    "calibrate": "cmr.calibration.calibrate",
    "diagnose": "cmr.diagnosis.diagnose",
    "read": "cmr.robot_log",
}
__all__ = [
    "CalibrationResult",
    "Diagnosis",
    "Effect",
    "ParameterFile",
    "Recording",
    "RobotLog",
    "__version__",
    "calibrate",
    "diagnose",
    "read",
]


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> object:
    if name in _MODULES:
        from importlib import import_module

        globals()[name] = found = getattr(import_module(_MODULES[name]), name)
        return found
    if name == "__version__":
        from cmr.distribution import version

        return version()
    if name == MESSAGES and not _generated(__path__):
        raise ImportError(
            f"the message classes cmr.{MESSAGES} have not been generated in {__path__[0]}. "
            "Install CMR from that checkout: pip install -e ."
        )
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
