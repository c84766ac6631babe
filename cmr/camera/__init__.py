"""A camera over the floor: where robots with tags are, and virtual robots drawn into its picture."""
