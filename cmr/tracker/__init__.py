"""Poses of real robots from motion capture systems: OptiTrack, Qualisys, VRPN, and those supported by
`motioncapture`.
"""
