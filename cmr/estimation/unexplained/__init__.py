"""Remaining structure in the residuals of the selected effects, and a generic term for it."""
