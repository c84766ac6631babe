"""What the effects found leave: whether structure remains, and a generic term for it."""
