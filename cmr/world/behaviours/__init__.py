"""Behaviours: what robots decide to do. The same behaviour drives virtual robots in cmr-sim and a real one through
cmr-pilot.
"""

from cmr.world.behaviours.behaviour import Behaviour, BehaviourError
from cmr.world.behaviours.following import Follow
from cmr.world.behaviours.leading import FigureEight
from cmr.world.behaviours.making import AnyBehaviour, make_behaviour, make_behaviours
from cmr.world.behaviours.team import TeamBehaviour

__all__ = [
    "AnyBehaviour",
    "Behaviour",
    "BehaviourError",
    "FigureEight",
    "Follow",
    "TeamBehaviour",
    "make_behaviour",
    "make_behaviours",
]
