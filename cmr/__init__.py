"""Calibrated Mixed Reality: real and virtual robots in one world.

Rooms: `bus` (channels, messages, processes on LCM), `recordings` (event logs as arrays), `parameters`
(the parameter file), `model` (how a robot moves), `calibration`, `world` (all robots, real and virtual),
`diagnosis`, `tools` (log tools), `commands` (the cmr-* processes). Imports run towards `model`, which knows nobody.

This module imports nothing, so that a command hears Ctrl-C before anything that takes time.
"""
