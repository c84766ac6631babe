"""Pages beside viser's: each visitor of one has a process of their own, which alone decides what becomes of it."""
