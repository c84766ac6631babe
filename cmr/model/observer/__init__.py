"""The model as an observer of recorded drives: prediction errors for many candidates at once.

`observer` prepares and composes the compiled code, `drives` joins recorded drives; the source of the loops is in
`loops`, their functions in `helpers`.
"""
