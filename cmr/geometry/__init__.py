"""Geometry of the floor and of drives: independent of all other packages except the model.

`places` are poses, points, discs and walls as plain numbers, `obstacles` the checked arrays of them and the geofence,
`figures` the figures that robots drive and stand in. `manoeuvres` are drives by name.
"""
