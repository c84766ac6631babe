"""Drives of the plant, cmr.plant, which shares no code with the model: what the model is checked against.

`manoeuvres` is what it may be told to drive, `drives` puts plant, noise and sensors together: arrays of a drive, or a
Recording of it; in `steering` a pilot drives who sees it.
"""

from cmr.plant.parameters import NEUTRAL, TYPICAL, PlantParameters, plant_parameters
from cmr.plant.sensors import REALISTIC, SILENT, Noise
from tests.reference_plant.drives import Commands, Drive, drive, packets, recording

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
