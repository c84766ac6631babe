"""How well a team with one real robot represents a team of real ones, and the effect of calibration on it.

`study` runs the same scenario with all robots real and with one, `preparing` calibrates and diagnoses that one,
`distances` compares the results, `report` and `plots` show them.
"""
