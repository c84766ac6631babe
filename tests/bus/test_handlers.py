"""Whatever takes messages takes them alike: `handle(utime, channel, message)`."""

from collections.abc import Callable

import pytest

from cmr.bus.estop import EmergencyStop
from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.streams import STREAMS, identify
from cmr.calibration.calibrator import Calibrator
from cmr.diagnosis.live.watcher import Watcher
from cmr.msg import estop_t, motor_feedback_t, pose_xyt_t
from cmr.parameters.following import ParameterFollower
from cmr.recordings.recording import Recorder
from cmr.view.orders import Orders
from cmr.view.state import ViewState
from cmr.world.behaviours import make_behaviour
from cmr.world.estimator import Estimator
from cmr.world.pilot import Pilot
from cmr.world.world import World

NOW = 1_700_000_000_000_000  # us
HANDLERS: dict[str, Callable[[], Callable[[int, str, Message], object]]] = {
    "calibrator": lambda: Calibrator(0).handle,
    "emergency stop": lambda: EmergencyStop().handle,
    "estimator": lambda: Estimator(0).handle,
    "follower of parameters": lambda: ParameterFollower(0).handle,
    "live diagnosis": lambda: Watcher(ParameterFollower).handle,
    "orders of the page": lambda: Orders().handle,
    "pilot": lambda: Pilot(0, make_behaviour("waypoints", {}), ParameterFollower(0)).handle,
    "recorder": lambda: Recorder(0).handle,
    "state of the page": lambda: ViewState().handle,
    "world": lambda: World([], ParameterFollower).handle,
}


@pytest.mark.parametrize("name", HANDLERS)
def test_a_handler_takes_time_channel_and_message_and_passes_over_channels_that_are_not_ours(name: str) -> None:
    handle = HANDLERS[name]()
    pose = make(pose_xyt_t, utime=NOW, robot_id=0, x=1.0, y=2.0, theta=0.5)
    for channel in ("POSE_7", "NOBODYS", "POSE_00"):
        assert not handle(NOW, channel, pose)
    handle(NOW, "POSE_0", pose)
    handle(NOW, "MOTOR_FEEDBACK_0", motor_feedback_t())
    handle(NOW, "ESTOP", make(estop_t, utime=NOW, engaged=True, source="hand", reason="a test"))


def test_the_name_of_a_channel_is_parsed_once() -> None:
    for stream in STREAMS:
        channel = stream.channel(7 if stream.per_robot else None)
        assert identify(channel) == (stream, 7 if stream.per_robot else None)
        assert identify(channel) is identify("".join(channel))
    assert identify("NOBODYS") is None
