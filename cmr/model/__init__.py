"""How a skid-steer robot moves: the one definition that simulation, calibration and documentation read.

The paper's model: `parameters` names its numbers, `motor` turns commands into wheel motion, `body` turns wheel motion
into motion over the floor; `paper` is both, compiled.

Effects: `catalogue` has one entry for each, from `effects/`; `stages` says what the equations of an entry may do,
`extended/` makes one compiled step out of all entries.

What others use: `motion` (one drive under many parameters), `fleet` (many robots, step by step), `sensitivity`
(one drive with derivatives), `sensors` (what encoders, gyro and an external pose make of a drive), `observer/` (by how
much sensors differ from what the model predicts of them). What is compiled, here and elsewhere, `compiled` compiles.
"""
