"""Many runs of one scenario: other seeds, other settings, on all cores or on many computers.

`settings` changes a scenario, `experiment` is one run, `journal` keeps what is done, `cluster` spreads the work,
`table` writes the rows down and draws them.
"""
