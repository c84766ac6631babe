"""Live runs of a scenario: its processes, its end, and the report.

`jobs` are the processes with their commands, `preparing` writes the files that they read, `live_run` starts them with
the supervisor (on other computers with `elsewhere`), sends waypoints, and measures with `watch`. `report` writes the
results, `page` their HTML page. `virtual` is cmr-sim's part of a scenario.
"""
