"""What is on the floor, and what is driven there, before any robot moves: it knows nobody but the model.

`places` are poses, points, discs and walls as plain numbers, `obstacles` the checked arrays of them and the geofence,
`figures` the figures that robots drive and stand in. `manoeuvres` are drives by name.
"""
