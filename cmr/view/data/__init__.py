"""The data shown by the page, from bus or log, in plain classes independent of both.

`intake` receives the messages of `live` or `playback`; `state` keeps their contents on robots and bus.
"""
