"""The world in a web page: what is shown, live from the bus or from a log, and the page that shows it.

The state is kept in plain classes independent of bus and page; only `stage`, `page` and `server` use viser.
"""
