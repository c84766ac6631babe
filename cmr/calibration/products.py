"""Sums of products for least squares, in one pass over the measurements."""

import numpy as np

from cmr.model.compiled import compiled

BLOCK = 256  # samples whitened at a time, to fit in the L1 cache


@compiled("void(f8[:, ::1], b1[::1], f8[::1], f8[:, ::1])")
def add_products(rows, past, weights, products):  # type: ignore[no-untyped-def]
    """Add the products of the innovations of `rows` (m, n) to the lower half of `products` (m, m).

    Innovations are sum_l weights[l] rows[:, k - l], with `weights` of shape (order + 1,); `past` (n - order,) marks
    samples with complete history, others do not count.
    """
    order = len(weights) - 1
    count, samples = rows.shape
    new = np.zeros((count, BLOCK))
    for first in range(order, samples, BLOCK):
        width = min(BLOCK, samples - first)
        for j in range(count):
            row, out = rows[j], new[j]
            for i in range(width):
                out[i] = weights[0] * row[first + i]
            for lag in range(1, order + 1):
                weight = weights[lag]
                for i in range(width):
                    out[i] += weight * row[first + i - lag]
            for i in range(width):
                out[i] = out[i] if past[first - order + i] else 0.0
            for i in range(width, BLOCK):
                out[i] = 0.0
        for j in range(count):
            for k in range(j + 1):
                a, b = new[j], new[k]
                s0 = s1 = s2 = s3 = 0.0
                # Four sums side by side vectorise.
                for i in range(0, BLOCK, 4):
                    s0 += a[i] * b[i]
                    s1 += a[i + 1] * b[i + 1]
                    s2 += a[i + 2] * b[i + 2]
                    s3 += a[i + 3] * b[i + 3]
                products[j, k] += (s0 + s1) + (s2 + s3)
