"""Processes that are started, kept alive and stopped, here and for experiments that another computer leads.

It needs LCM alone, as it runs on robots' own computers, too: a `job` is one process, `children` are those that run,
`supervisor` starts again what dies, `requests` are what `cmr-run` asks of other computers, and `agent` serves them.
"""
