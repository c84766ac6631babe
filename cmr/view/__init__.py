"""The world in a web page: what is shown, live from the bus or from a log, and the page that shows it.

What is shown is kept in plain classes that know neither bus nor page; only `stage`, `page` and `server` know viser.
"""
