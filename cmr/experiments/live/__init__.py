"""A scenario run live: the processes that it needs, when it is over, and the report afterwards.

`jobs` are the processes with their commands, `preparing` writes the files that they read, `live_run` starts them by
`supervisor` (here, and on other computers by `elsewhere`), sends the team off and watches it by `watch`. `report`
writes what came out, `page` the page of it. `virtual` is what cmr-sim takes from a scenario.
"""
