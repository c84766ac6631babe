"""Monitor robots while they drive, detect changes in their motion, and suggest causes.

Once a second, `second` compares what was received from a robot (`hearing`) with the predictions from its parameters
(`twin`). `measures` are the differences used, and `expectation` learns their usual sizes for this robot and floor from
the first seconds of motion. `changes` are the possible shifts of the measures, `detection` detects a change,
`explaining` finds the best of the `causes`. Faults that need no statistics are in `faults`. `robot` combines these for
one robot, `watcher` for all on the bus.
"""

from cmr.diagnosis.live.watcher import Watcher

__all__ = ["Watcher"]
