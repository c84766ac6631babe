"""Health of controller and battery: when the motors must be held, and what is reported."""

from cmr.msg import motor_feedback_t
from robot_driver.battery import BatteryGuard, Thresholds
from robot_driver.command_gate import CommandGate, Stop
from robot_driver.controllers import Request, Telemetry, conditions_of
from robot_driver.readings import Readings, sentence_on

PATIENCE = 2.0  # times the age at which a reading is old; beyond it, the motors are held


class Health:
    """Processes the slow readings of the controller at `path`, made in turn once in a few `period` (s); holds and
    releases the `gate`.

    The motors are held until the `essential` readings have arrived, and the voltage if there is a limit for it. Times
    are the driver's monotonic clock (s).
    """

    def __init__(
        self, gate: CommandGate, thresholds: Thresholds, essential: frozenset[str], path: str, period: float
    ) -> None:
        self._gate = gate
        self._path = path
        self._battery = BatteryGuard(thresholds)
        self._needs_voltage = thresholds.stop > 0.0
        self._readings = Readings(period, essential | ({"battery_voltage"} if self._needs_voltage else set()))

    def begin(self, requests: int) -> None:
        """Forget all readings: a new connection was made, on which this many requests for telemetry are made in
        turn.
        """
        self._readings.begin(requests)

    def take(self, request: Request[Telemetry], answer: Telemetry, now: float) -> None:
        """Store the answer to a request."""
        self._readings.take(request, answer, now)
        if "battery_voltage" in answer:
            self._battery.take(answer["battery_voltage"], now)

    def recent(self, now: float) -> Telemetry:
        """Return the recent readings."""
        return self._readings.recent(now)

    def missing(self, now: float) -> set[str]:
        """Return the essential quantities not reported for so long that the motors must be held."""
        limit = PATIENCE * self._readings.old_after
        return {key for key, seconds in self._readings.unknown(now).items() if seconds > limit}

    def act(self, now: float) -> str:
        """Hold or release the motors according to the readings; return a sentence for the user, or ""."""
        recent, missing = self._readings.recent(now), self.missing(now)
        engaged = bool(recent.get("status", 0) & motor_feedback_t.STATUS_ESTOP)
        self._decide(Stop.CONTROLLER, hold=engaged or "status" in missing, release="status" in recent)
        blind = self._needs_voltage and "battery_voltage" in missing
        self._decide(Stop.VOLTAGE_UNKNOWN, hold=blind, release="battery_voltage" in recent)
        self._decide(Stop.BATTERY, hold=self._battery.empty, release=False)
        conditions = ", ".join(conditions_of(recent))
        sentences = (
            self._battery.sentence,
            f"The motor controller reports: {conditions}." if conditions else "",
            sentence_on(self._readings.unknown(now), self._path),
            "Not driving until it does and zero is commanded." if blind or "status" in missing else "",
        )
        return " ".join(filter(None, sentences))

    def _decide(self, stop: Stop, *, hold: bool, release: bool) -> None:
        if hold:
            self._gate.hold(stop)
        elif release:
            self._gate.release(stop)
