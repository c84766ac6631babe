"""The joystick: a page of its own beside viser's, made for phones, with which robots are driven by hand.

`sessions` relays what a visitor's page says to a process of cmr-teleop, and back; `said` is what such a page may say.
"""
