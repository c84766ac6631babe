"""Independent simulation of a robot, written from the equations alone: it shares no code with the model, which it
tests.

It implements every effect of the catalogue, and physics that are in no catalogue. `parameters` defines all parameters;
`motors`, `ground` and `physics` are the equations of the robot, `state` its state variables, `sensors` its readings;
`running` is one robot advanced from event to event. `beyond_motors`, `beyond_ground` and `beyond_sensors` hold physics
from the literature that no effect of the catalogue describes.
"""
