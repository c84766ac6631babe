"""What robots decide to do. The same behaviour drives a virtual robot in cmr-sim and a real one through cmr-pilot."""

from cmr.world.behaviours.behaviour import Behaviour, BehaviourError, make_behaviour
from cmr.world.behaviours.following import Follow
from cmr.world.behaviours.leading import FigureEight

__all__ = ["Behaviour", "BehaviourError", "FigureEight", "Follow", "make_behaviour"]
