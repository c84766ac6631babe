"""Acceptance tests of the driver's promises on the user's own hardware: provoke faults, measure, and judge.

`filter` sits between driver and device, and degrades the line; `relay` moves its bytes; `dialects` interprets them.
`bench` runs the driver and listens on the bus. `sessions` are the test steps, `judges` decide from the recordings
whether a promise held. `command` is `cmr accept`.
"""
