"""Faults that single seconds reveal: stalled wheels, frozen, jumping or missing poses, a low battery."""

import math
import statistics
from collections import deque
from collections.abc import Iterator

from cmr.diagnosis.live.causes import Voltage
from cmr.diagnosis.live.measures import MOVING_SECONDS
from cmr.diagnosis.live.second import FROZEN_WAY, LEAST_ANGLE, PoseSteps, Second
from cmr.diagnosis.live.suspicion import Suspicion
from cmr.msg import motor_feedback_t

MEANT = 0.15  # duty; a smaller one may not move the wheels, unless a controller regulates them
STANDING = 0.1  # rad in a second
SURE_AFTER = 2  # seconds of standing still
MISSED_AFTER = 3  # seconds without a sensor that was there before
LINGERING = 3  # seconds for which a fault must be absent
JUMP, TURN_JUMP = 0.1, 0.2  # m, rad; smaller steps are left to the statistics
UNUSUAL = 5.0  # times the usual jump; localisation that always jumps is noisy
REMEMBERED = 60  # seconds that determine the usual jump
LOW = 0.1  # share by which the voltage has fallen
PRESENT_VOLTAGE = 10  # seconds over which the voltage is taken

POSE_MEASURES = frozenset({"forward", "sideways", "heading", "turn_by_pose"})
WHEEL_MEASURES = frozenset({"drive", "steer", "turn_by_gyro", "turn_by_pose", "forward", "sideways"})
CONDITIONS = (
    (motor_feedback_t.STATUS_ESTOP, "the emergency stop is engaged; release it"),
    (motor_feedback_t.STATUS_NOT_ARMED, "the motors are not armed; start cmr-driver again"),
    (
        motor_feedback_t.STATUS_MOTOR_FAULT,
        "the controller reports a fault or overcurrent; check whether something is blocked",
    ),
    (motor_feedback_t.STATUS_TEMPERATURE, "the controller is too hot; let it cool down"),
    (motor_feedback_t.STATUS_COMMAND_STALE, "commands reach the driver too late; check the network"),
)


class Faults:
    """The faults of one robot, by key; `muted` are measures made invalid by the last second's faults."""

    def __init__(self) -> None:
        self.present: dict[str, Suspicion] = {}
        self.muted: frozenset[str] = frozenset()
        self._number = 0  # of the second
        self._seen: dict[str, int] = {}  # number of the second in which a fault was last seen
        self._standing = [0, 0]  # seconds for which the wheels of each side have stood still
        self._missed: dict[str, int] = {}  # seconds since a sensor was last received
        self._jumps: deque[tuple[float, float]] = deque(maxlen=REMEMBERED)
        self._first_voltages: list[float] = []
        self._last_voltages: deque[float] = deque(maxlen=PRESENT_VOLTAGE)

    @property
    def voltage(self) -> Voltage:
        """The battery's voltage at the start and now."""
        if len(self._first_voltages) < MOVING_SECONDS:
            return Voltage(math.nan, math.nan)
        return Voltage(statistics.median(self._first_voltages), statistics.median(self._last_voltages))

    def hears(self, sensor: str) -> bool:
        """Return whether gyro or poses are received."""
        return self._missed.get(sensor, MISSED_AFTER) < MISSED_AFTER

    def add(self, second: Second) -> None:
        """Process one more second."""
        self._number += 1
        self.muted = frozenset()
        for find in (self._standing_still, self._sensors, self._localisation, self._battery):
            for key, suspicion in find(second):
                self.present[key] = suspicion
                self._seen[key] = self._number
        for key in [key for key in self.present if self._number - self._seen[key] > LINGERING]:
            del self.present[key]

    def _standing_still(self, second: Second) -> Iterator[tuple[str, Suspicion]]:
        for side in (0, 1):
            # A driver that forwards no commands also keeps the twin standing.
            wanted = second.commanded[side] > (0.0 if second.by_speed else MEANT) and (
                second.wanted.path[side] > LEAST_ANGLE or second.applied[side] == 0.0
            )
            stands = second.floor.path[side] < STANDING * float(second.parameters.wheel_radius)
            if not stands:
                self._standing[side] = 0
            elif wanted or self._standing[side] >= SURE_AFTER:
                self._standing[side] += 1
        if any(self._standing):
            self.muted |= WHEEL_MEASURES
        stuck = [seconds >= SURE_AFTER for seconds in self._standing]
        if any(stuck):
            name = "both sides'" if all(stuck) else "the left" if stuck[0] else "the right"
            duty = max(second.commanded[side] for side in (0, 1) if stuck[side])
            at = f"speed of {duty * second.top_speed:.1f} rad/s" if second.by_speed else f"duty of {duty:.2f}"
            seen = f"{name[0].upper()}{name[1:]} wheels stand still at a commanded {at}"
            yield "standing", Suspicion(f"{name} wheels standing still", f"{seen}: {_why_standing(second, stuck)}.")

    def _sensors(self, second: Second) -> Iterator[tuple[str, Suspicion]]:
        there = {"gyro": not math.isnan(second.gyro), "poses": second.pose is not None}
        for name, known in there.items():
            if known:
                self._missed[name] = 0
            elif name in self._missed:
                self._missed[name] += 1
            if self._missed.get(name, 0) >= MISSED_AFTER:
                what = "gyro readings" if name == "gyro" else "poses"
                yield (
                    f"no {name}",
                    Suspicion(
                        f"missing {what}",
                        f"For {MISSED_AFTER} s there have been no usable {what}: the sensor or its process has "
                        "stopped, or its clock is off. Changes that only they show go undetected.",
                    ),
                )

    def _localisation(self, second: Second) -> Iterator[tuple[str, Suspicion]]:
        if second.pose is None:
            return
        if second.pose.same and (second.pose.moved or "frozen" in self.present):
            self.muted |= POSE_MEASURES
            yield (
                "frozen",
                Suspicion(
                    "frozen poses",
                    "The poses stay exactly the same while the wheels turn: the localisation is at fault, not the "
                    "robot. Check whether it still sees the robot.",
                ),
            )
        jump = self._jump(second.pose)
        if jump and "frozen" not in self.present:
            self.muted |= POSE_MEASURES
            if second.resting:
                why = "the localisation is at fault, or somebody moved the robot"
            else:
                why = "the localisation is at fault, not the robot. Check its markers or its map"
            yield (
                "jump",
                Suspicion("", f"The pose jumped by {jump} more than the wheels can have moved the robot: {why}."),
            )

    def _jump(self, pose: PoseSteps) -> str:
        """Return the size of a jump of the pose, with unit; empty without a jump."""
        usual = [statistics.median(sizes) for sizes in zip(*self._jumps, strict=True)] or [0.0, 0.0]
        self._jumps.append((pose.jump, pose.turn_jump))
        if pose.jump > JUMP + UNUSUAL * usual[0]:
            return f"{pose.jump:.2f} m"
        return f"{pose.turn_jump:.2f} rad" if pose.turn_jump > TURN_JUMP + UNUSUAL * usual[1] else ""

    def _battery(self, second: Second) -> Iterator[tuple[str, Suspicion]]:
        if second.moving and second.voltage > 0.0:
            if len(self._first_voltages) < MOVING_SECONDS:
                self._first_voltages.append(second.voltage)
            self._last_voltages.append(second.voltage)
        voltage = self.voltage
        if second.status & motor_feedback_t.STATUS_BATTERY:
            shows = f"; it shows {second.voltage:.1f} V" if second.voltage > 0.0 else ""
            yield (
                "battery",
                Suspicion("low battery", f"The controller reports a low battery voltage{shows}. Charge the battery."),
            )
        elif voltage.known and voltage.fall > LOW:
            sentence = f"Suspected: low battery (effect battery_drift); {voltage}. Charge the battery."
            yield "battery", Suspicion("low battery", sentence, voltage.fall)


def _moves(second: Second, side: int) -> bool:
    """Return whether, by the poses, a side of the robot moves as far as its wheels should have turned."""
    if second.pose is None:
        return False
    parameters = second.parameters
    turned = second.pose.turn * float(parameters.base_width) / 2.0
    ground = second.pose.forward + (turned if side else -turned)
    wanted = float(parameters.wheel_radius) * second.wanted.turned[side]
    return abs(ground) > FROZEN_WAY and abs(ground - wanted) < 0.5 * abs(wanted)


def _why_standing(second: Second, stuck: list[bool]) -> str:
    """Return why wheels may stand still, and what to do."""
    for bit, reason in CONDITIONS:
        if second.status & bit:
            return reason
    if all(second.applied[side] == 0.0 for side in (0, 1) if stuck[side]):
        return "the driver does not forward the commands; see its PROCESS_STATUS"
    if any(_moves(second, side) for side in (0, 1) if stuck[side]):
        return "but the robot moves, so the encoder is at fault; check its cable"
    if second.by_speed:
        return "a motor is off or blocked, or the robot does not take commands; check its own stop, power and cables"
    return "the motor is off or blocked, or the duty is too small to overcome friction; check power, cables and wheels"
