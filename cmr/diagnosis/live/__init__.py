"""Watch robots while they drive, and say when one begins to move differently, and why that may be.

Once a second, `second` puts what was heard of a robot (`hearing`) beside what its parameters predict (`twin`).
`measures` are the differences looked at, `expectation` learns from the first seconds of motion how large they are for
this robot on this floor. `changes` are the ways in which they may shift, `detection` notices that one has,
`explaining` finds out which of the `causes` fits best. What needs no statistics is in `faults`. `robot` puts these
together for one robot, `watcher` for all on the bus.
"""

from cmr.diagnosis.live.watcher import Watcher

__all__ = ["Watcher"]
