"""A camera over the floor: finds the poses of tagged robots and draws virtual robots into the picture."""
