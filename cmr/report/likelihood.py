"""Format probabilities: in words, and as the length of a bar."""

import math

SURE, MOST = 0.99, 10_000  # probability above which odds are given instead; the largest odds shown
LEAST = 1e-3  # probability at which a bar has length 0; every factor of ten is a third of it


def odds(probability: float) -> str:
    """Format a probability: in per cent, small ones as 1 : 250, near-certain ones as 250 : 1."""
    if probability > SURE:
        against = 1.0 - probability
        return f"{probability / against:.0f} : 1" if MOST * against > probability else f"over {MOST} : 1"
    if probability >= 0.01:
        return f"{100.0 * probability:.0f} %"
    return f"1 : {1.0 / probability:.0f}" if probability > 0.0 else "gone"


def length(probability: float) -> float:
    """Return the share [0 to 1] of its track that a bar fills, on a log scale from LEAST to 1."""
    if probability <= LEAST:
        return 0.0
    return 1.0 - math.log(min(probability, 1.0)) / math.log(LEAST)
