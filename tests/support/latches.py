"""What drivers report of the emergency stop."""

from typing import Any

from cmr.bus.messages import make
from cmr.msg import estop_latch_t

NOW = 1_700_000_000_000_000  # us


def latch(robot_id: int, engaged: bool, **fields: Any) -> estop_latch_t:
    """Return a report of a robot that Ada stopped, or released."""
    about = {"utime": NOW, "stored": True, "since_utime": NOW, "source": "Ada", "reason": "smoke"} | fields
    return make(estop_latch_t, robot_id=robot_id, engaged=engaged, **about)
