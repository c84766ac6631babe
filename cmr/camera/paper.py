"""Sizes of paper that boards and tags are printed on."""

PAPERS = {"a4": (0.297, 0.210), "a3": (0.420, 0.297), "letter": (0.2794, 0.2159)}  # m, wide and high
