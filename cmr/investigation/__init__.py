"""An investigation: a robot finds out what its simulation gets wrong. Arrays in, the next movement out.

The engine knows no bus and no world. `behaviour` does: `cmr-pilot` and `cmr-investigate` drive with it. So do
`reporting`, which publishes the remaining explanations, and `sensing`, the sensors of virtual robots. `rehearsing`
loads slow modules before a robot drives.

`movements` draws candidate movements, `floor` says where the robot may be, `prediction` predicts paths and what each
explanation would make of the sensors, `separation` scores candidates by how well they separate explanations, `judging`
weighs the explanations on the data so far, and `engine` puts these together, decision by decision.
"""
