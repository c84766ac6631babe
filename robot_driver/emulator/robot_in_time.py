"""An emulated robot over time, independent of the clock used: bytes, poses and the plant advance event by event.

It does no I/O and reads no clock. Times are s since the robot was switched on.
"""

import heapq
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Protocol

from robot_driver.emulator.device import Device, Transmission
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.sensors import MotionCapture, Pose

LONGEST_HOLD = 0.008  # s; clients of RoboClaws wait 10 ms for the next byte, the device itself waits as long


class Adapter(Protocol):
    """The adapter between a device's wire and its client."""

    def pieces(self, begin: float, end: float, data: bytes) -> Iterable[tuple[float, bytes]]:
        """Return the pieces in which the client receives bytes that are on the wire from `begin` to `end`, and when."""


class NoAdapter:
    """The client receives everything when the last byte has left the wire."""

    def pieces(self, begin: float, end: float, data: bytes) -> Iterable[tuple[float, bytes]]:
        """Return one piece, at the end."""
        del begin
        return ((end, data),)


class StreamingAdapter:
    """A client that gets long answers in parts, as from real adapters, with gaps below LONGEST_HOLD."""

    def pieces(self, begin: float, end: float, data: bytes) -> list[tuple[float, bytes]]:
        """Return equal pieces, each when its last byte has left the wire."""
        if end - begin < LONGEST_HOLD:
            return [(end, data)]
        count = min(len(data), math.floor((end - begin) / LONGEST_HOLD) + 1)
        places = [len(data) * number // count for number in range(count + 1)]
        moments = [end - (end - begin) * (len(data) - place) / len(data) for place in places]
        return [
            (moment, data[place:after]) for place, after, moment in zip(places, places[1:], moments[1:], strict=False)
        ]


class WireLine:
    """A device, its adapter, and until when (s) the wire is busy in each direction.

    `arriving` are the bytes that reach the client at `arrives` (s), which is infinity for none.
    """

    def __init__(self, name: str, device: Device, adapter: Adapter) -> None:
        self.name = name
        self.device = device
        self.adapter = adapter
        self.wake_time = device.wake_time  # changes only when the device receives or acts
        self.busy_to_device = 0.0
        self.busy_to_client = 0.0
        self.arriving, self.arrives = bytearray(), math.inf

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Pass bytes to the device, the last of which arrived at `time`."""
        sent = self.device.receive(data, time)
        self.wake_time = self.device.wake_time
        return sent

    def wake(self, time: float) -> list[Transmission]:
        """Let the device act on its own."""
        sent = self.device.wake(time)
        self.wake_time = self.device.wake_time
        return sent


class RobotInTime:
    """The plant, its devices and cameras, and all data in transit between them.

    The plant is advanced to the exact time of each event: a request's last byte has arrived, a sample is due. Bytes of
    a device go to `deliver(name, data)`, poses of the cameras to `on_pose`, each when due.
    """

    def __init__(
        self,
        plant: Plant,
        devices: Mapping[str, Device],
        deliver: Callable[[str, bytes], None],
        *,
        adapters: Mapping[str, Adapter] | None = None,
        motion_capture: MotionCapture | None = None,
        on_pose: Callable[[Pose], None] = lambda _pose: None,
    ) -> None:
        self.plant = plant
        self.now = 0.0  # time of the last event
        self.until = 0.0
        adapters = adapters or {}
        self._lines = {
            name: WireLine(name, device, adapters.get(name, NoAdapter())) for name, device in devices.items()
        }
        self._in_order = list(self._lines.values())
        self._deliver = deliver
        self._motion_capture = motion_capture
        self._on_pose = on_pose
        self._events: list[tuple[float, int, Callable[[], object]]] = []
        self._next_wake = self._earliest_wake()
        self._order = itertools.count()  # events of equal time are processed in the order in which they were scheduled

    def bring(self, name: str, data: bytes, start: float) -> None:
        """Send a client's bytes to a device, at `start` or after those still on the wire."""
        if data:
            line = self._lines[name]
            arrival = max(start, line.busy_to_device) + len(data) * line.device.byte_time
            line.busy_to_device = arrival
            self._schedule(arrival, partial(self._receive, line, data, arrival))

    def next_due(self) -> float:
        """Return the time of the earliest event, or at which the first device acts."""
        return min(self._events[0][0], self._next_wake) if self._events else self._next_wake

    def let_happen(self, until: float) -> float:
        """Process everything due by `until`, in order of time; return when the next is due.

        Events may set `until` to an earlier time.
        """
        self.until = until
        events = self._events
        while True:
            is_event = bool(events) and events[0][0] <= self._next_wake
            due = events[0][0] if is_event else self._next_wake
            if due > self.until:
                return due
            self.now = due
            if is_event:
                heapq.heappop(events)[2]()
            else:
                self.plant.advance(due)
                self._look(due)

    def _look(self, due: float) -> None:
        """Let the cameras, or the device that is due, sample the robot."""
        if self._motion_capture is not None and self._motion_capture.wake_time <= due:
            pose = self._motion_capture.wake(due)
            self._schedule(pose.ready, partial(self._on_pose, pose))
        else:
            line = self._in_order[0]
            for other in self._in_order:
                if other.wake_time < line.wake_time:
                    line = other
            self._send(line, line.wake(due))
        self._next_wake = self._earliest_wake()

    def _earliest_wake(self) -> float:
        """Return when a device or the cameras next act on their own."""
        earliest = math.inf if self._motion_capture is None else self._motion_capture.wake_time
        for line in self._in_order:
            if line.wake_time < earliest:
                earliest = line.wake_time
        return earliest

    def _receive(self, line: WireLine, data: bytes, arrival: float) -> None:
        self.plant.advance(arrival)
        self._send(line, line.receive(data, arrival))
        self._next_wake = self._earliest_wake()

    def _send(self, line: WireLine, transmissions: list[Transmission]) -> None:
        """Deliver bytes to the client after their time on the wire, and after those still on it."""
        for time, data in transmissions:
            on_wire = len(data) * line.device.byte_time
            line.busy_to_client = end = max(time, line.busy_to_client + on_wire)
            for moment, piece in line.adapter.pieces(end - on_wire, end, data):
                if moment == line.arrives:
                    line.arriving += piece
                    continue
                line.arriving, line.arrives = bytearray(piece), moment
                self._schedule(moment, partial(self._arrive, line, line.arriving))

    def _arrive(self, line: WireLine, data: bytearray) -> None:
        if data is line.arriving:
            line.arrives = math.inf
        self._deliver(line.name, bytes(data))

    def _schedule(self, moment: float, action: Callable[[], object]) -> None:
        heapq.heappush(self._events, (moment, next(self._order), action))
