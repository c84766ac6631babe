"""Calibrate during a drive: collect messages, detect the end of the manoeuvre, and fit.

It is independent of the bus and uses only the messages' time stamps, so a log, replayed at any speed or read directly,
gives the same results as the drive itself.
"""

import math
from collections.abc import Iterator

import numpy as np

from cmr.bus.message import Message
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import PARAMETERS, VELOCITY_COMMAND, Stream, identify
from cmr.calibration.calibrate import AVERAGE, PAPER, calibrate
from cmr.calibration.coverage import MOVING_AT_ALL, Coverage, second_speed
from cmr.calibration.fitting import PAPER_PARAMETERS
from cmr.calibration.loading import NOMINAL, made_up_recording
from cmr.calibration.result import CalibrationResult
from cmr.calibration.running import RunningFit
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.model.velocity_controller import Q, VelocityController
from cmr.msg import calibration_status_t, motor_feedback_t
from cmr.parameters.file import ParameterFile
from cmr.recordings.arrivals import COMMAND_SIGNALS, KEPT, LAST_NUMBER, RobotMessages
from cmr.recordings.commanding import COMMANDS, asked_by
from cmr.recordings.recording import Recorder, Recording
from cmr.recordings.signal import SECONDS

REST = 1_000_000  # us at rest that end the manoeuvre;
LONG_REST = 3_000_000  # us of rest after a drive at a single speed: the robot may be about to continue at another
STRAGGLERS = 500_000  # us beyond the end for which messages stamped before it are awaited
# us kept before the first motion: more than is used, as a motor may be driven before it turns.
BEFORE = 12_000_000
FORGET = 20_000_000  # us; interval at which data older than BEFORE are dropped for a robot that has not moved yet
LONGEST = 1_200_000_000  # us; a drive that is not covered after this is dropped, because memory is limited
HEARD = (*dict.fromkeys(kept.stream for kept in KEPT.values()), PARAMETERS)  # all streams of a recording
LAP = 30.0  # s, of a usual figure-eight
FIRST_LOOK = 3.0  # s of motion that give a first estimate
ENOUGH = 10.0  # a robot that does not stop is calibrated once every bucket holds this many times its minimum
LOADING = "Loading the estimator. At its first use on a computer it is compiled, which takes a minute."
WAITING = (
    "Waiting for the robot to move: drive figure-eights, both lobes, best for 30 s at about 0.2 m/s and then for 30 s "
    "at about 0.5 m/s."
)
FORGOTTEN = f"The drive of {LONGEST * SECONDS / 60.0:.0f} minutes so far was incomplete and has been discarded."


class Calibrator:
    """The calibration of one robot.

    `nominal` gives at least the wheel radius; None takes the newest parameters announced during the drive. `method` and
    `paper_only` are those of `calibrate`. `state` is one of the states of calibration_status_t; `result` is there once
    `fit` succeeded. `preview` is the estimate from the last call of `look`, `averages` counts the averages so far.
    `missing` says what the drive still lacks. `loading` is true until `load` has finished.
    """

    def __init__(
        self, robot_id: int, nominal: ParameterFile | None = None, *, method: str = AVERAGE, paper_only: bool = False
    ) -> None:
        self.robot_id = robot_id
        self.state: int = calibration_status_t.WAITING
        self.result: CalibrationResult | None = None
        self.preview: CalibrationResult | None = None
        self.failure = ""
        self._nominal, self._method, self._paper_only = nominal, method, paper_only
        self.loading = False
        self._running = self._running_fit(nominal)
        self._recorder = Recorder(robot_id)
        self._log: RobotMessages | None = None
        self._coverage = Coverage()
        self._has_wheels = False
        self._onset: int | None = None
        self._last_motion: int | None = None
        self._end: int | None = None
        self._latest = 0
        self._forgotten = 0
        self._is_second = False  # whether an earlier drive was discarded
        self.left_out = 0.0  # s of a log after the manoeuvre

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Handle one message; those of other robots, and those after the manoeuvre, are ignored."""
        stream, robot_id = identify(channel) or (None, None)
        if stream is None or stream not in HEARD or robot_id != self.robot_id or self.complete:
            return
        self._recorder.handle(utime, channel, message)
        self._latest = max(self._latest, utime)
        if self._onset is None and self._latest > self._forgotten + FORGET:
            # A robot may be parked for hours before it drives.
            self._forget()
        elif self._onset is not None and self._end is None and self._latest > self._onset + LONGEST:
            self._forget()
            self._coverage, self._onset, self._last_motion = Coverage(), None, None
            self._running, self.preview = self._running_fit(self._nominal), None
            self.state, self._is_second = calibration_status_t.WAITING, True
        if isinstance(message, motor_feedback_t):
            self._has_wheels = True
            self._watch(utime, message.psi_left, message.psi_right)
        elif isinstance(message, COMMANDS) and not self._has_wheels:
            self._watch(utime, *self._asked(stream, *asked_by(message)))

    def _forget(self) -> None:
        self._recorder.forget(self._latest - BEFORE)
        self._forgotten = self._latest

    @classmethod
    def of(cls, messages: RobotMessages, nominal: ParameterFile | None = None) -> "Calibrator":
        """Return the calibrator after a whole log, as if it had handled message by message.

        If a drive would end in another piece of the recording than it began, and pieces are shorter than a lap, it uses
        all of them.
        """
        calibrator = cls(messages.robot_id, nominal)
        calibrator._log = messages
        number, latest = messages.latest_utime()
        calibrator._latest = int(latest[-1]) if len(latest) else 0
        for utime, left, right in calibrator._motion(messages):
            calibrator._watch(utime, left, right)
        if calibrator._end is not None and calibrator._in_short_pieces(Recording.of(messages)):
            calibrator._end, calibrator.state = None, calibration_status_t.COLLECTING
        if calibrator._end is not None:
            over = int(np.searchsorted(latest, calibrator._end + STRAGGLERS, side="right"))
            if over < len(number):
                calibrator.left_out = (int(latest[-1]) - int(latest[over])) * SECONDS
                messages = messages.until(int(number[over]))
                calibrator._latest = int(latest[over])
            calibrator._log = messages
        return calibrator

    def _in_short_pieces(self, recording: Recording) -> bool:
        """Return whether the manoeuvre spans pieces of a recording that are too short to be one."""
        assert self._onset is not None
        assert self._end is not None
        begin, end = recording.pieces.number(np.array([self._onset, self._end]))
        return bool(begin != end) and recording.pieces.usual < LAP

    @property
    def complete(self) -> bool:
        """Whether the manoeuvre is over and all its messages had time to arrive."""
        return self._end is not None and self._latest > self._end + STRAGGLERS

    @property
    def measured(self) -> int:
        """The number of received messages that only a real robot sends."""
        return self._messages.measured

    @property
    def _messages(self) -> RobotMessages:
        return self._recorder.messages() if self._log is None else self._log

    @property
    def _known(self) -> ParameterFile | None:
        """The nominal parameters, or the announced ones."""
        return self._nominal or (self._recorder.parameters if self._log is None else self._log.parameters)

    @property
    def missing(self) -> str:
        """What the drive still lacks, as text; empty when it is covered."""
        return self._coverage.missing

    def recording(self) -> Recording:
        """Return the recording of the manoeuvre: from some rest before the first motion to its end (so far)."""
        recording = Recording.of(self._messages)
        first = 0 if self._onset is None else self._onset - BEFORE
        return recording.between(first, self._end if self._end is not None else self._latest)

    @property
    def averages(self) -> int:
        """How many averages were taken of the drive so far."""
        return self._running.averages

    def load(self) -> None:
        """Load the estimator, and compile it at the first use on a computer, by fitting a short synthetic drive."""
        try:
            recording = made_up_recording()
            running = self._running_fit(NOMINAL)
            for part in (0.9, 1.0):  # an average, and the fit after one
                running.look(recording.between(0, int(part * recording.wheels.utime[-1])))
            calibrate(recording, NOMINAL, method=self._method, paper_only=self._paper_only)
        finally:
            self.loading = False

    def _running_fit(self, nominal: ParameterFile | None) -> RunningFit:
        return RunningFit(nominal, paper=self._method == PAPER, paper_only=self._paper_only)

    @property
    def tells_something(self) -> bool:
        """Whether the robot is driven and has moved long enough for a first estimate."""
        return self.state == calibration_status_t.COLLECTING and self._coverage.seconds[MOVING_AT_ALL] > FIRST_LOOK

    def look(self, recording: Recording) -> None:
        """Estimate the parameters from the drive so far, a recent `recording()`, for `status`."""
        try:
            self.preview = self._running.look(recording)
        except Exception:  # too little data yet; faults of the whole drive are reported by its fit
            self.preview = None

    def fit(self) -> CalibrationResult | None:
        """Fit the parameters to the collected data; None if this fails.

        `failure` explains why it failed, or why the result must not be written.
        """
        try:
            self.result = calibrate(self.recording(), self._nominal, method=self._method, paper_only=self._paper_only)
            self.failure = self.result.why_no_file
        except EstimationError as error:
            self.failure = str(error)
        except Exception as error:  # a fit that breaks down must be reported, not leave the process waiting for ever
            self.failure = f"The fit broke down on this recording ({type(error).__name__}: {error}). Keep the log."
        self.state = calibration_status_t.FAILED if self.failure else calibration_status_t.DONE
        return self.result

    @property
    def so_far(self) -> dict[str, Estimate]:
        """The current estimates, under the names in the robot's file, with the same caution as in `status`."""
        found = self.result or self.preview
        reported = found.reported if found else {}
        return {name: Estimate(one.value, one.std * self._caution) for name, one in reported.items()}

    def status(self) -> calibration_status_t:
        """Return the current calibration_status_t message."""
        fields: dict[str, float] = {}
        found = self.result or self.preview
        for name in PAPER_PARAMETERS:
            estimate = found.estimates.get(name) if found else None
            fields[name] = estimate.value if estimate else math.nan
            fields[f"{name}_std"] = estimate.std * self._caution if estimate else math.nan
        return make(
            calibration_status_t,
            utime=now_utime(),
            robot_id=self.robot_id,
            state=self.state,
            progress=1.0 if self._end is not None else self._coverage.progress,
            path_rmse_before=found.path_rmse_before if found else math.nan,
            path_rmse_after=found.path_rmse_after if found else math.nan,
            message=self._sentence(),
            **fields,
        )

    @property
    def _caution(self) -> float:
        """The factor that widens the standard deviations of an ongoing drive; 1 for a complete one.

        Friction and slip vary over a lap. In a shorter drive the residuals do not show that yet, so standard deviations
        computed from them are too small.
        """
        if self.result is not None:
            return 1.0
        return 1.0 + (LAP / max(self._coverage.seconds[MOVING_AT_ALL], FIRST_LOOK)) ** 2

    def _motion(self, messages: RobotMessages) -> Iterator[tuple[int, float, float]]:
        """Yield the motion of both sides in order: from commands until wheels are received, then from these."""
        wheels = messages.arrivals["wheels"]
        first_wheels = wheels.number[0] if len(wheels.number) else LAST_NUMBER
        rows: list[tuple[int, int, float, float]] = []
        for name in COMMAND_SIGNALS:
            before = messages.arrivals[name].where(messages.arrivals[name].number < first_wheels)
            left, right = self._asked(KEPT[name].stream, *(before.columns[field] for field in KEPT[name].fields))
            rows += zip(*(column.tolist() for column in (before.number, before.utime, left, right)), strict=True)
        for _, utime, at_left, at_right in sorted(rows):
            yield utime, at_left, at_right
        columns = (wheels.utime, wheels.columns["psi_left"], wheels.columns["psi_right"])
        yield from zip(*(column.tolist() for column in columns), strict=True)

    def _asked(self, stream: Stream[Message], first: Q, second: Q) -> tuple[Q, Q]:
        """Return the commanded motion of both sides' wheels: duties, or speeds.

        Body rates are converted with the known width; without one, commands are not used.
        """
        if stream is not VELOCITY_COMMAND:
            return first, second
        width = self._known.counted_width if self._known else math.nan
        return VelocityController(1.0, width, math.nan).wheels_of_body(first, second)  # m/s are as good as rad/s here

    def _watch(self, utime: int, left: float, right: float) -> None:
        """Track the motion; detect its end."""
        if self._end is not None or not (math.isfinite(left) and math.isfinite(right)):
            return
        if self._coverage.add(utime, left, right):
            self._last_motion = utime
            if self._onset is None:
                self._onset = utime
                self.state = calibration_status_t.COLLECTING
        rested = 0 if self._last_motion is None else utime - self._last_motion
        if (self._coverage.complete and self._ends(rested)) or self._coverage.exceeds(ENOUGH):
            self._end = utime
            self.state = calibration_status_t.FITTING

    def _ends(self, rested: int) -> bool:
        """Return whether a rest of this duration [us] ends a covered drive."""
        return rested >= LONG_REST or (rested >= REST and self._coverage.only_speed is None)

    def _radius(self) -> float | None:
        """The wheel radius [m], if known."""
        nominal = self._known
        return nominal.value("wheel_radius") if nominal is not None and nominal.has("wheel_radius") else None

    def _covered(self) -> str:
        """Say what to do once the drive is covered."""
        only = self._coverage.only_speed
        if only is None:
            return "Covered. Stop the robot to finish."
        radius = self._radius() if self._has_wheels else None
        at, other = "one speed", "another speed, less than half or more than twice as fast,"
        if radius is not None:
            at, other = f"{only * radius:.2g} m/s", f"about {second_speed(only * radius):.1g} m/s"
        stop = f"stop for {LONG_REST * 1e-6:.0f} s to finish"
        return f"Covered at {at}. Drive on at {other} for narrower intervals, or {stop}."

    def _sentence(self) -> str:
        if self.state == calibration_status_t.WAITING:
            return LOADING if self.loading else f"{FORGOTTEN} {WAITING}" if self._is_second else WAITING
        if self.state == calibration_status_t.COLLECTING:
            return f"Still needed: {self.missing}." if self.missing else self._covered()
        if self.state == calibration_status_t.FITTING:
            return "The manoeuvre is complete; computing the parameters."
        if self.result is None or self.failure:
            return self.failure
        skipped = "; ".join(f"{name} not identifiable: {why}" for name, why in self.result.unidentified.items())
        return " ".join(["Parameters found.", *([skipped + "."] if skipped else []), *self.result.notes])
