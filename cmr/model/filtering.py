"""Discrete poses that represent the past of a first-order filter, for trackers that smooth."""

import numpy as np

# A first-order filter of time constant T weighs the past with exp(-t/T)/T. Poses at three times represent it by
# Gauss-Laguerre quadrature, exact for motions up to the fifth power of time: their ages, in T, and their weights
# (Abramowitz and Stegun, Handbook of Mathematical Functions, 1964, table 25.9).
FILTER_AGES = np.array([0.415774556783, 2.294280360279, 6.289945082937])
FILTER_WEIGHTS = np.array([0.711093009929, 0.278517733569, 0.010389256502])
