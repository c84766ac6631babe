"""Many runs of one scenario with varied seeds and settings, on all cores or many computers.

`settings` varies a scenario, `experiment` is one run, `journal` keeps results, `cluster` distributes the work, `table`
writes and plots the rows.
"""
