"""Start, supervise and stop processes, locally and for experiments that another computer leads.

It needs only LCM, because it also runs on robots' computers: a `job` is one process, `children` are running ones,
`supervisor` restarts what dies, `requests` are sent by `cmr-run` to other computers, and `agent` serves them.
"""
