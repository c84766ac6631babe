"""A robot that finds out by itself what its simulation gets wrong: arrays in, the next movement out.

The engine knows no bus and no world; `behaviour`, with which `cmr-pilot` and `cmr-investigate` drive, does, and so do
`reporting`, which says on the bus what is left, and `sensing`, the sensors of virtual robots. `rehearsing` loads all
that takes time before a robot drives.

`movements` draws candidate movements, `floor` says where the robot may be, `prediction` predicts paths and what each
explanation would make of the sensors, `separation` scores candidates by how well they separate explanations, `judging`
weighs the explanations on the data so far, and `engine` puts these together, decision by decision.
"""
