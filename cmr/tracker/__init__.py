"""Poses of real robots from motion capture systems: OptiTrack, Qualisys, VRPN, and those that `motioncapture` reads."""
