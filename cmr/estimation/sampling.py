"""A random walk over sets of effects whose sizes have a normal posterior.

The state is a set of effects with their sizes. A move switches one effect, or two that resemble each other, and draws
the sizes of all that are on from their normal posterior; it is accepted by the ratio of the sets' probabilities, in
which the sizes are integrated out, if all sizes have a sign that is possible (Metropolis and Hastings: the ratio of the
target and the normal from which the sizes are drawn is the same wherever signs are possible).
"""

import numpy as np

from cmr.model.compiled import compiled, inlined
from cmr.recordings.signal import Floats, Mask

MOST_ON = 40  # sizes at once
RESEMBLING = 4  # of each effect: those whose changes are most like its own
BURN_IN = 0.2  # of the steps
Indices = np.typing.NDArray[np.int64]


def neighbours(normal: Floats, groups: Indices) -> Indices:
    """Return pairs of effects (e, 2) that resemble each other most, by the products of what their sizes change."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    alike = np.abs(normal) / np.outer(scale, scale)
    count = int(groups.max()) + 1 if len(groups) else 0
    largest = np.zeros((count, count))
    np.maximum.at(largest, (groups[:, None], groups[None, :]), alike)
    np.fill_diagonal(largest, -1.0)
    nearest = np.argsort(-largest, axis=1)[:, :RESEMBLING]
    pairs = {(min(one, int(other)), max(one, int(other))) for one, row in enumerate(nearest) for other in row}
    return np.array(sorted(pairs), np.int64).reshape(-1, 2)


def walk(
    normal: Floats,
    pull: Floats,
    groups: Indices,
    one_sided: Mask,
    edges: Indices,
    present: float,
    begin: Mask,
    steps: int,
    random: np.random.Generator,
) -> tuple[Floats, Floats, Floats]:
    """Return means (p,) and mean products (p, p) of the sizes, and how often each effect (e,) is on.

    The log-likelihood of sizes s is -s' `normal` s / 2 - `pull`' s; their prior is normal with variance 1, one half of
    it where `one_sided` (p,). `groups` (p,) tells to which effect each size belongs. The walk begins with the effects
    `begin` (e,) switched on; `present` is the prior probability of each.
    """
    mean, products, shares = np.zeros(len(pull)), np.zeros((len(pull), len(pull))), np.zeros(len(begin))
    moves = random.integers(0, len(begin) + len(edges), steps)
    chances = np.log(random.uniform(size=steps))
    draws = random.standard_normal((steps, MOST_ON))
    _walk(
        np.ascontiguousarray(normal), np.ascontiguousarray(pull), groups, one_sided.astype(np.uint8), edges,
        float(np.log(present / (1.0 - present))), begin.astype(np.uint8), moves, chances, draws,
        mean, products, shares,
    )  # fmt: skip
    return mean, products, shares


@inlined
def _evidence(normal, pull, on, count, factor, solved):  # type: ignore[no-untyped-def]
    """Return the log of the probability of the sizes `on`, integrated out; fill the Cholesky factor and L^-1 pull."""
    total = 0.0
    for i in range(count):
        for j in range(i + 1):
            value = normal[on[i], on[j]] + (1.0 if i == j else 0.0)
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            factor[i, j] = np.sqrt(value) if i == j else value / factor[j, j]
        value = -pull[on[i]]
        for k in range(i):
            value -= factor[i, k] * solved[k]
        solved[i] = value / factor[i, i]
        total += 0.5 * solved[i] ** 2 - np.log(factor[i, i])
    return total


@compiled(
    "void(f8[:, ::1], f8[::1], i8[::1], u1[::1], i8[:, ::1], f8, u1[::1], i8[::1], f8[::1], f8[:, ::1],"
    "f8[::1], f8[:, ::1], f8[::1])"
)
def _walk(normal, pull, groups, one_sided, edges, odds, begin, moves, chances, draws, mean, products, shares):  # type: ignore[no-untyped-def]
    """Walk; see `walk`. `odds` is the log of the prior odds of an effect."""
    count, effects = len(pull), len(begin)
    state, tried = begin.copy(), begin.copy()
    on, drawn = np.empty(MOST_ON, np.int64), np.empty(MOST_ON)
    factor, solved, sizes = np.empty((MOST_ON, MOST_ON)), np.empty(MOST_ON), np.zeros(count)
    here, settled, kept, begun = -np.inf, int(BURN_IN * len(moves)), 0, False
    for step in range(len(moves)):
        tried[:] = state
        if step == 0:
            pass  # the state that it begins with
        elif moves[step] < effects:
            tried[moves[step]] = 1 - tried[moves[step]]
        else:
            for end in range(2):
                effect = edges[moves[step] - effects, end]
                tried[effect] = 1 - tried[effect]
        chosen, there = 0, 0.0
        for index in range(count):
            if tried[groups[index]] and chosen < MOST_ON:
                on[chosen] = index
                chosen += 1
                there += np.log(2.0) if one_sided[index] else 0.0
        for effect in range(effects):
            there += odds if tried[effect] else 0.0
        there += _evidence(normal, pull, on, chosen, factor, solved)
        # Until one state has been possible, none is refused for being unlikely.
        if not begun or chances[step] < there - here:
            possible = True
            for i in range(chosen - 1, -1, -1):
                value = solved[i] + draws[step, i]
                for k in range(i + 1, chosen):
                    value -= factor[k, i] * drawn[k]
                drawn[i] = value / factor[i, i]
                possible &= drawn[i] > 0.0 or not one_sided[on[i]]
            if possible:
                state[:] = tried
                here, begun = there, True
                sizes[:] = 0.0
                for i in range(chosen):
                    sizes[on[i]] = drawn[i]
        if step >= settled:
            kept += 1
            for effect in range(effects):
                shares[effect] += state[effect]
            for one in range(count):
                if sizes[one] != 0.0:
                    mean[one] += sizes[one]
                    for other in range(count):
                        products[one, other] += sizes[one] * sizes[other]
    for one in range(count):
        mean[one] /= kept
        for other in range(count):
            products[one, other] /= kept
    for effect in range(effects):
        shares[effect] /= kept
