"""A robot as it really is, written from the equations alone: it shares no code with the model, whose judge it is.

It knows every effect of the catalogue, and physics that are in no catalogue. `parameters` names every number of the
plant; `motors`, `ground` and `physics` are the robot itself, `state` what it carries from one moment to the next,
`sensors` what its sensors say of it; `running` is one robot whose time goes on from event to event. `beyond_motors`,
`beyond_ground` and `beyond_sensors` hold physics of the literature that no effect of the catalogue describes.
"""
