"""How a skid-steer robot moves: the one definition that simulation, calibration and documentation read.

`parameters` names the model's numbers, `motor` turns commands into wheel motion, `body` turns wheel motion
into motion over the floor, `motion` joins the two: one step of many robots, or one drive under many parameters.
Every function is pure and broadcasts over NumPy arrays.
"""
