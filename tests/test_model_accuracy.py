"""The model's 10 ms step against the reference plant, which knows nothing of it and takes steps of 10 us."""

import numpy as np

from cmr.model.fleet import Fleet
from cmr.model.motion import RobotState, Trajectory, drive
from cmr.model.parameters import RobotParameters
from cmr.recordings.signal import Floats
from tests.reference_plant import NEUTRAL, Commands, packets
from tests.reference_plant.drives import true_motion
from tests.reference_plant.manoeuvres import figure_eight

SPAN = 0.01  # s
ROBOT = RobotParameters(NEUTRAL.wheel_radius, NEUTRAL.k2_over_k3, NEUTRAL.k1, NEUTRAL.base_width)


def borders(seconds: float) -> Floats:
    """Times of the spans of a drive at 100 Hz [s]."""
    return np.arange(round(seconds / SPAN) + 1, dtype=np.float64) * SPAN


def duties(commands: Commands, seconds: float) -> tuple[Floats, Floats]:
    """The duties in force during each span."""
    index = np.searchsorted(commands.time, borders(seconds)[:-1] + 0.5 * SPAN) - 1
    return commands.left[index], commands.right[index]


def modelled(commands: Commands, seconds: float) -> Trajectory:
    left, right = duties(commands, seconds)
    return drive(left, right, np.full(len(left), SPAN), ROBOT, RobotState.at_rest())


def distances(model: Trajectory, truth: dict[str, Floats]) -> Floats:
    distance: Floats = np.hypot(model.x - truth["x"], model.y - truth["y"])
    return distance


def test_the_papers_model_is_within_1e7_m_of_the_truth_after_a_minute_of_figure_eights() -> None:
    commands = packets(figure_eight(60.0, 3), 60.0)
    truth = true_motion(commands, {}, borders(60.0))
    assert distances(modelled(commands, 60.0), truth).max() < 1e-7


def test_a_fleet_drives_what_the_reference_drives() -> None:
    commands = packets(figure_eight(20.0, 1), 20.0)
    truth = true_motion(commands, {}, borders(20.0))
    fleet = Fleet(SPAN)
    fleet.add(RobotState.at_rest(), ROBOT)
    for k, (left, right) in enumerate(zip(*duties(commands, 20.0), strict=True)):
        fleet.command(0, left, right)
        fleet.advance()
        state = fleet.states(0)
        assert np.hypot(state.x - truth["x"][k + 1], state.y - truth["y"][k + 1]) < 1e-7
