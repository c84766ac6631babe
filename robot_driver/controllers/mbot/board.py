"""The MBot board as a motor controller: it receives duties and the time, and sends everything else unasked.

Without time messages (TIMESYNC) it stops the motors after 1 s and falls silent; when the time is sent again, it
continues with the last duties. So the time is only sent together with duties, and after them. A silent board may have
received half a frame long ago, which the next bytes would complete: it first gets meaningless bytes, and then the
duties several times, so that it certainly continues with these. The time sent is our monotonic clock, in which it then
stamps its messages, late by the transmission: 1 ms on USB. Each time message sets its clock again, so they are sent no
more often than needed. Sources: mbot-project/mbot_firmware, src/mbot_classic.c and src/mbot_comms.c. Some versions
interpret MOTOR_PWM_CMD as velocities. This cannot be detected while everything is zero; at the first duty the board
reports a different one from what was sent, and is no longer driven.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import TypeVar

from robot_driver.controllers.controller import BadReply, Controller, Request, Telemetry
from robot_driver.controllers.mbot.frames import Frame, FrameReader
from robot_driver.controllers.mbot.gyro import MBotGyro
from robot_driver.gate.wire_mbot import DUTIES, MOMENT, NOTHING, REPEATED, Topic, packed

T = TypeVar("T")

COUNTER_RANGE = 2**32
WATCHDOG = 1.0  # s; built in
TIME_TELLING = 250_000  # us
SILENCE = 100_000  # us after which the board may have missed the time
# us after which the board reports what it was sent, unless it missed it: USB delays bytes by up to 16 ms
UNHEARD = 20_000
WATCHDOG_IGNORED = 1.5  # s of sending without time that show that there is no watchdog
BATTERY = 7  # index in ANALOG_IN of the battery's voltage, behind four raw values and three other voltages
REMEMBERED = 100  # duties last sent, one of which may be in force; older ones have expired by any watchdog
UNTOLD = 3  # consecutive reports of duties that were never sent, which indicate another firmware
EVERYTHING = 4096  # bytes; whatever has come


class MBot(Controller):
    """An MBot of the classic kind; the left motor is first, the right one second, both positive forward."""

    default_baud_rate = 115200  # has no meaning on USB
    link = "firmware that talks to LCM and confirms the duties that it is sent, on the second of its two ports,"
    watchdog_seconds = WATCHDOG
    streams = True
    gyro = MBotGyro

    def __init__(self) -> None:
        self._reader = FrameReader()
        self._latest: dict[Topic, Frame] = {}
        self._watchdog: float | None = None
        self._duties: deque[tuple[float, float]] = deque(maxlen=REMEMBERED)  # sent, as the board has them
        self._untold: set[int] = set()  # when duties were sent after which it reported others, us
        self._told_duties = 0  # us, our monotonic clock
        self._confirming: Frame | None = None  # the first that reported the duties last sent
        self._told_time = -TIME_TELLING  # us

    def identify(self) -> Request[str]:
        """Wait for any message; the board reports no name."""
        return self._wait("greeting", lambda: "MBot control board" if self._latest else None)

    def learn(self) -> list[Request[None]]:
        """Return nothing: there are no dialects."""
        return []

    def set_watchdog(self, seconds: float) -> Request[None]:
        """Do nothing, as the watchdog is built in. Raises ValueError for any other time than that of the board."""
        if seconds != WATCHDOG:
            raise ValueError(f"The watchdog of this board is set to {WATCHDOG:g} s and cannot be set to {seconds:g} s.")
        return _answered("watchdog", None)

    def read_watchdog(self) -> Request[float]:
        """Measure once how long the board continues after the last time message (s); then only check that it still
        sends.

        A reset does not change its watchdog; but a board that was reset is silent until the time is sent again.
        """
        if (known := self._watchdog) is not None:
            since = self.monotonic_ns() // 1000 - UNHEARD
            return self._wait("watchdog", lambda: known if self._has_talked(since) else None)
        data, _ = self._tell(0.0, 0.0, time_too=True)
        stated = self._told_time

        def talked() -> float:
            frame = self._latest.get(Topic.MOTOR_PWM)
            return 0.0 if frame is None else (frame.utime - stated) / 1e6

        def parse(_reply: bytes) -> float:
            seconds = round(talked(), 1)
            if seconds < WATCHDOG:
                raise BadReply(f"The board fell silent {seconds:g} s after the time was sent to it.")
            self._watchdog = seconds
            return seconds

        missing = self._missing_until(lambda: talked() > WATCHDOG_IGNORED)
        return Request("watchdog", data, 0, missing, parse, ends_in_silence=True)

    def drive(self, first: float, second: float) -> Request[tuple[float, float]]:
        """Send the duties and the time; the board confirms with the duties in force since then.

        If it continues with others, there is no wait. Raises ValueError for a duty outside [-1, 1].
        """
        if not (abs(first) <= 1.0 and abs(second) <= 1.0):
            raise ValueError(f"A duty must be between -1 and 1, not {first}, {second}.")
        data, in_wire = self._tell(first, -second)

        def confirmed() -> tuple[float, float] | None:
            return (in_wire[0], -in_wire[1]) if self._confirming is not None else None

        def in_force_since() -> int:
            assert self._confirming is not None
            return self._confirming.measured

        def unheard() -> bool:
            frame = self._fresh(Topic.MOTOR_PWM)
            return frame is not None and frame.utime >= self._told_duties + UNHEARD

        return self._wait("duties", confirmed, data, in_force_since, unheard)

    def read_encoders(self) -> Request[tuple[int, int]]:
        """Take the newest counts; the right wheel's grow backward."""
        taken: list[Frame] = []

        def counts() -> tuple[int, int] | None:
            frame = self._fresh(Topic.ENCODERS)
            if frame is None:
                return None
            taken.append(frame)
            left, right = (int(count) for count in frame.values[:2])
            return left % COUNTER_RANGE, -right % COUNTER_RANGE

        return self._wait("encoders", counts, measured=lambda: taken[-1].measured)

    def read_telemetry(self) -> list[Request[Telemetry]]:
        """Take the battery's voltage, where the board says it."""

        def battery() -> Telemetry | None:
            frame = self._fresh(Topic.ANALOG_IN)
            if frame is None or not math.isfinite(frame.values[BATTERY]):
                return None
            return Telemetry(battery_voltage=frame.values[BATTERY])

        return [self._wait("battery", battery)]

    def _tell(self, left: float, right: float, *, time_too: bool = False) -> tuple[bytes, tuple[float, float]]:
        """Return the bytes that set the board's duties, and its clock if due; and the duties as rounded."""
        now = self.monotonic_ns() // 1000
        payload = DUTIES.pack(now, left, right, 0.0)
        in_wire = DUTIES.unpack(payload)[1:3]
        self._duties.append(in_wire)
        self._confirming = None
        data, self._told_duties = packed(Topic.MOTOR_PWM_COMMAND, payload), now
        last_said = max((frame.utime for frame in self._latest.values()), default=-SILENCE)
        # Messages from the future were sent while our clock stood still, in a suspended computer.
        is_silent = abs(now - last_said) >= SILENCE
        if is_silent:
            data = NOTHING + REPEATED * data
        if time_too or is_silent or now - self._told_time >= TIME_TELLING:
            data, self._told_time = data + packed(Topic.TIMESYNC, MOMENT.pack(now)), now
        return data, in_wire

    def _doubt(self, frame: Frame) -> None:
        """Refuse to drive when the board repeatedly reports duties that were never sent.

        Damage may change one message, which stays in force until the next, but hardly ever three in a row.
        """
        if frame.topic is not Topic.MOTOR_PWM or frame.utime < self._told_duties:
            return
        duties = frame.values[:2]
        if duties == (0.0, 0.0) or duties in self._duties:
            self._untold.clear()
        else:
            self._untold.add(self._told_duties)
        if len(self._untold) >= UNTOLD and self._watchdog is not None:
            self.objection = (
                "Not driving: the board reports duties other than those sent, so its firmware takes them for "
                "velocities or numbers its topics otherwise. Install the firmware that docs/how_to/set_up_a_robot.md "
                "names, then restart."
            )

    def _foreign(self) -> str:
        """Return an explanation if nothing known was received; starts with a space, or is ""."""
        topics = ", ".join(map(str, sorted(self._reader.foreign)))
        if self._latest or not topics:
            return ""
        return (
            f" It says only topics {topics}, so its firmware is another: install the one that "
            "docs/how_to/set_up_a_robot.md names."
        )

    def _has_talked(self, since: int) -> bool:
        """Return whether the board has sent anything since a time (us, our monotonic clock)."""
        now = self.monotonic_ns() // 1000
        return any(since <= frame.utime <= now for frame in self._latest.values())

    def _fresh(self, topic: Topic) -> Frame | None:
        """Return the latest frame of a topic if it was sent after the board received the last duties."""
        frame = self._latest.get(topic)
        return frame if frame is not None and self._is_fresh(frame) else None

    def _is_fresh(self, frame: Frame) -> bool:
        return self._told_duties <= frame.utime <= self.monotonic_ns() // 1000

    def _confirm(self, frame: Frame) -> None:
        """Keep the first frame that reports the last duties: they are in force since then."""
        said = frame.topic is Topic.MOTOR_PWM and self._duties and frame.values[:2] == self._duties[-1]
        if said and self._confirming is None and self._is_fresh(frame):
            self._confirming = frame

    def _wait(
        self,
        name: str,
        find: Callable[[], T | None],
        data: bytes = b"",
        measured: Callable[[], int] | None = None,
        in_vain: Callable[[], bool] = lambda: False,
    ) -> Request[T]:
        """Return a request that is answered when `find` finds something in the latest frames.

        It fails as soon as waiting is `in_vain`.
        """

        def parse(_reply: bytes) -> T:
            found = find()
            if found is None:
                raise BadReply(f"The board did not say its {name} in time.{self._foreign()}")
            return found

        missing = self._missing_until(lambda: find() is not None or in_vain())
        return Request(name, data, 0, missing, parse, measured=measured)

    def _missing_until(self, ready: Callable[[], bool]) -> Callable[[bytes], int]:
        """Return a function that receives a growing reply, and asks for more until it is `ready`."""
        seen = 0

        def missing(reply: bytes) -> int:
            nonlocal seen
            seen = min(seen, len(reply))  # a request may be repeated
            for frame in self._reader.feed(reply[seen:]):
                self._latest[frame.topic] = frame
                self._doubt(frame)
                self._confirm(frame)
            seen = len(reply)
            return 0 if ready() else EVERYTHING

        return missing


def _answered(name: str, answer: T) -> Request[T]:
    """Return a request that needs nothing from the board."""
    return Request(name, b"", 0, lambda _reply: 0, lambda _reply: answer)
