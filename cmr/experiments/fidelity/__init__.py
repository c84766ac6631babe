"""How well a team with one real robot stands for a team of real ones, and what calibration does for it.

`study` runs the same scenario with all robots real and with one, `preparing` calibrates and diagnoses that one,
`distances` compares what came out, `report` and `plots` show it.
"""
