"""Drives around calibrations in a log, collected while reading, so that seeking need not read them again."""

from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.streams import CALIBRATION_STATUS, WORLD_STATE
from cmr.msg import calibration_status_t, world_state_t
from cmr.recordings.events import Event
from cmr.view.data.drives import Calibrations, Drives
from cmr.view.data.robots import RobotTable

PARTS_WITHIN = 10_000  # us in which the parts of one WORLD_STATE are logged


class DriveWatch:
    """Tracks robots and twins through a log; `calibrations` are those so far."""

    def __init__(self) -> None:
        self.calibrations = Calibrations()
        self._table = RobotTable()
        self._drives = Drives()
        self._begun = 0  # when the first part of the last WORLD_STATE was logged [us]
        self._states: dict[int, int] = {}

    def take(self, utime: int, event: Event) -> None:
        """Process one event, `utime` [us of the log's own time]."""
        if event.channel != WORLD_STATE.name and not event.channel.startswith(CALIBRATION_STATUS.name):
            return
        try:
            received = decode(event.channel, event.data)
        except RejectedMessage:
            return
        message = received.message
        if isinstance(message, world_state_t):
            self._take_world(utime, message)
        elif isinstance(message, calibration_status_t):
            self._take_calibration(utime, message.robot_id, message.state)

    def _take_world(self, utime: int, message: world_state_t) -> None:
        if utime - self._begun > PARTS_WITHIN:  # all parts of the previous one have arrived
            if self._drives.due(self._begun):
                self._drives.sample(self._begun, *self._table.present(self._begun).fresh().with_twins())
            self._begun = utime
        self._table.take_world(utime, message)

    def _take_calibration(self, utime: int, robot_id: int, state: int) -> None:
        done = calibration_status_t.DONE
        if state == done != self._states.get(robot_id):
            self.calibrations.add(utime, robot_id, self._drives.calibrated(robot_id))
        self._states[robot_id] = state
