"""What the page shows, from the bus or from a log, in plain classes that know neither.

`intake` takes the messages, of `live` or of `playback`; `state` keeps what they say of the robots and of the bus.
"""
