"""How a skid-steer robot moves: the one definition used by simulation, calibration and documentation.

The paper's model: `parameters` defines its numbers, `motor` turns commands into wheel motion, `body` turns wheel motion
into motion over the floor; `paper` is both, compiled.

Effects: `catalogue` has one entry for each, from `effects/`; `stages` defines what the equations of an entry may do,
`extended/` makes one compiled step out of all entries.

For other packages: `motion` (one drive under many parameters), `fleet` (many robots, step by step), `sensitivity` (one
drive with derivatives), `sensors` (simulated encoders, gyro and external pose), `observer/` (prediction errors of
recorded sensors). All compilation is done by `compiled`.
"""
