"""What stops a robot that investigates: an emergency stop, and poses that cease; it goes on from rest, and says so."""

from pathlib import Path

import numpy as np

from cmr.bus.messages import make
from cmr.bus.streams import ESTOP
from cmr.geometry.obstacles import Geofence
from cmr.investigation.behaviour import Investigate
from cmr.investigation.driving import PAUSE
from cmr.msg import estop_t
from cmr.recordings.signal import Floats
from tests.investigation.planners import Never
from tests.support.pilot_bench import PERIOD, Bench

SQUARE = Geofence([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
UNTIL_IT_SPINS = 70  # turns: the opening begins with a rest of a second
FOR_A_WHILE = 60  # turns


def spinning(folder: Path) -> tuple[Bench, Investigate]:
    """Return a robot in its opening."""
    behaviour = Investigate(planner=Never())
    bench = Bench(folder, behaviour, geofence=SQUARE)
    assert np.any([bench.turn() for _ in range(UNTIL_IT_SPINS)][-1])
    return bench, behaviour


def turns(bench: Bench, count: int, *, pose: bool = True) -> Floats:
    """Return the duties of so many turns, (count, 2)."""
    return np.array([bench.turn(pose=pose) for _ in range(count)])


def stop(bench: Bench, *, engaged: bool) -> None:
    """Engage the emergency stop, or release it."""
    message = make(estop_t, utime=bench.utime, engaged=engaged, source="hand", reason="a child in the lab")
    bench.pilot.handle(bench.utime, ESTOP.name, message)


def goes_on_from_rest(bench: Bench, behaviour: Investigate) -> None:
    """Check that the movement that was interrupted is not driven on, and that the drive says so."""
    assert not np.any(turns(bench, round(PAUSE / PERIOD * 1e6)))
    assert behaviour.driving is not None
    assert behaviour.driving.note.startswith("The drive was interrupted for")


def test_an_emergency_stop_ends_the_movement(tmp_path: Path) -> None:
    """No duty from the first turn on, and none after the release: what was planned is not valid any more."""
    bench, behaviour = spinning(tmp_path)
    stop(bench, engaged=True)
    assert not np.any(turns(bench, FOR_A_WHILE))
    assert "emergency stop" in bench.pilot.waiting_for
    stop(bench, engaged=False)
    goes_on_from_rest(bench, behaviour)


def test_poses_that_cease_end_the_movement(tmp_path: Path) -> None:
    """Without poses nobody knows whether it is on the floor: it stops within half a second, and says why."""
    bench, behaviour = spinning(tmp_path)
    duties = turns(bench, FOR_A_WHILE, pose=False)
    assert not np.any(duties[round(0.5 / PERIOD * 1e6) :])
    assert "pose" in bench.pilot.waiting_for
    goes_on_from_rest(bench, behaviour)
