"""A robot to check the model against: written from the equations alone, sharing no code with the model.

`parameters` names every number of the plant; `motors`, `ground` and `physics` are the robot itself, `state` what it
carries from one moment to the next, `sensors` what its sensors say of it. `manoeuvres` is what it may be told to drive,
`drives` puts them together: arrays of a drive, or a Recording of it; in `steering` a pilot drives who sees it.
"""

from tests.reference_plant.drives import Commands, Drive, drive, packets, recording
from tests.reference_plant.parameters import NEUTRAL, TYPICAL, PlantParameters, plant_parameters
from tests.reference_plant.sensors import REALISTIC, SILENT, Noise

__all__ = [
    "NEUTRAL",
    "REALISTIC",
    "SILENT",
    "TYPICAL",
    "Commands",
    "Drive",
    "Noise",
    "PlantParameters",
    "drive",
    "packets",
    "plant_parameters",
    "recording",
]
