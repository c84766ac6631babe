"""How likely something is, for people: in words, and as the length of a bar."""

import math

SURE, MOST = 0.99, 10_000  # probability from which on odds are said in its place; the largest odds that are
LEAST = 1e-3  # probability of which a bar has no length; every tenfold is a third of it


def odds(probability: float) -> str:
    """Return a probability as one says it: in per cent, small ones as 1 : 250, and what is nearly sure as 250 : 1."""
    if probability > SURE:
        against = 1.0 - probability
        return f"{probability / against:.0f} : 1" if MOST * against > probability else f"over {MOST} : 1"
    if probability >= 0.01:
        return f"{100.0 * probability:.0f} %"
    return f"1 : {1.0 / probability:.0f}" if probability > 0.0 else "gone"


def length(probability: float) -> float:
    """Return the share [0 to 1] of its track that a bar fills: the logarithm, from LEAST to certainty."""
    if probability <= LEAST:
        return 0.0
    return 1.0 - math.log(min(probability, 1.0)) / math.log(LEAST)
