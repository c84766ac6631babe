"""Proves the driver's promises on the user's own hardware: provokes what can go wrong, measures, and judges.

`filter` stands between driver and device, and makes a line worse than it is; `relay` moves its bytes; `dialects` knows
what they mean. `bench` runs the driver and listens on the bus. `sessions` are what is done with them, `judges` decide
from what was recorded whether a promise held. `command` is `cmr accept`.
"""
