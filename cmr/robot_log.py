"""Read logs in the library: `cmr.read("run.lcm").calibrate().plot()`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cmr.cli.progress import Progress
from cmr.distribution import how_to_install
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped, unused-ignore]

    from cmr.calibration.result import CalibrationResult
    from cmr.diagnosis.result import Diagnosis


def read(path: Path | str, robot: int | None = None) -> "RobotLog":
    """Read a robot's data from an LCM event log; `robot` is its id, needed only if the log has several.

    Raises RecordingError when the log cannot be opened, holds no robot, or several and `robot` is not given.
    """
    return RobotLog(Path(path), Recording.read(path, robot))


@dataclass(frozen=True, repr=False)
class RobotLog:
    """An event log, and the recording of one robot in it."""

    path: Path
    recording: Recording

    @property
    def robot(self) -> int:
        """The robot's id."""
        return self.recording.robot_id

    @property
    def seconds(self) -> float:
        """The time from the first sample of any signal to the last [s]."""
        times = [signal.utime for signal in self.recording.signals.values() if len(signal)]
        return SECONDS * float(max(one[-1] for one in times) - min(one[0] for one in times)) if times else 0.0

    def calibrate(self, nominal: ParameterFile | None = None) -> "CalibrationResult":
        """Return the robot's parameters. `nominal` has at least wheel_radius; by default it comes from the log.

        Raises EstimationError when the log does not determine them.
        """
        from cmr.calibration.calibrate import calibrate

        with Progress() as progress:
            progress.show(f"Calibrating robot {self.robot}.")
            return calibrate([self.recording], nominal)

    def diagnose(self, nominal: ParameterFile | None = None) -> "Diagnosis":
        """Diagnose the discrepancies between this robot and its simulation, and their causes. `nominal` is as for
        `calibrate`.

        Raises EstimationError when the model cannot be fitted to the log.
        """
        from cmr.diagnosis.diagnose import diagnose

        with Progress() as progress:
            return diagnose(self.recording, nominal, sources=[str(self.path)], progress=progress.show)

    def to_pandas(self) -> "dict[str, pandas.DataFrame]":
        """Return a table per signal, by its name: a column for each field, time of day (UTC) as index `time`.

        Raises ImportError where pandas is not installed.
        """
        try:
            import pandas
        except ModuleNotFoundError as error:
            raise ImportError(f"to_pandas needs pandas. To install it: {how_to_install('pandas')}") from error
        return {
            name: pandas.DataFrame(
                signal.fields, index=pandas.to_datetime(signal.utime, unit="us", utc=True).rename("time")
            )
            for name, signal in self.recording.signals.items()
        }

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.path}: robot {self.robot}, {self.seconds:.1f} s>"

    def _repr_html_(self) -> str:
        from cmr.report.markup import tag

        rows = [
            tag("tr", tag("td", name), tag("td", str(len(signal))), tag("td", ", ".join(signal.fields)))
            for name, signal in self.recording.signals.items()
        ]
        caption = tag("caption", f"{self.path}: robot {self.robot}, {self.seconds:.1f} s")
        head = tag("tr", tag("th", "signal"), tag("th", "samples"), tag("th", "fields"))
        return tag("table", caption, head, *rows)
