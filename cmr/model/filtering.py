"""Poses that stand for the past of a first-order filter, as a tracker may have that smooths what it measures."""

import numpy as np

# A first-order filter of time constant T weighs the past with exp(-t/T)/T. Poses of three moments stand for it, those
# of Gauss and Laguerre, exact for motions up to the fifth power of time: how long ago they were, in T, and what they
# weigh (Abramowitz and Stegun, Handbook of Mathematical Functions, 1964, table 25.9).
FILTER_AGES = np.array([0.415774556783, 2.294280360279, 6.289945082937])
FILTER_WEIGHTS = np.array([0.711093009929, 0.278517733569, 0.010389256502])
