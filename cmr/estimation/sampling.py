"""A random walk over sets of effects whose sizes have a normal posterior.

The state is a set of effects with their sizes. A move switches one effect, or two that resemble each other, and draws
the sizes of all that are on from their normal posterior, one after the other, each with a sign that is possible (GHK;
V. A. Hajivassiliou et al., J. Econometrics 72, 1996). It is accepted by the ratio of the sets' probabilities, in which
sizes of all signs are integrated out, times how likely possible signs were as the sizes were drawn (Metropolis and
Hastings: that is the ratio of the target and the density of the draw).

Sets that imitate each other are far apart. So several walks run in parallel, each with a smaller power of the
likelihood than the one before, and exchange their sets (parallel tempering; C. J. Geyer, Markov chain Monte Carlo
maximum likelihood, Computing Science and Statistics 23, 1991). Only the first one counts.
"""

from math import erfc

import numpy as np

from cmr.model.compiled import compiled, inlined
from cmr.recordings.signal import Floats, Mask

BELIEFS = (1.0, 0.5, 0.25, 0.1)  # power of the likelihood in each walk
MOST_ON = 40  # largest number of sizes in a set
RESEMBLING = 4  # number of most similar effects that can be exchanged with each effect
BURN_IN = 0.2  # of the steps
FAR = -30.0  # standard deviations beyond which the first term of a normal's tail is accurate to 1e-3
Indices = np.typing.NDArray[np.int64]


def neighbours(normal: Floats, groups: Indices) -> Indices:
    """Return the most similar pairs of effects (e, 2), by the products of their traces."""
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
    normal: Floats, pull: Floats, groups: Indices, one_sided: Mask, odds: Floats, begin: Mask, steps: int, seed: int
) -> tuple[Floats, Floats, Floats, Mask]:
    """Sample sets; return means (p,) and mean products (p, p) of sizes, each effect's frequency (e,), and the likeliest
    set.

    The log-likelihood of sizes s is -s' `normal` s / 2 - `pull`' s; their prior is normal with variance 1, one half of
    it where `one_sided` (p,). `groups` (p,) says to which effect each size belongs, `odds` (e,) the logarithm of the
    prior odds of each effect. Every other walk begins with the effects `begin` (e,) switched on. The same `seed` gives
    the same walk.
    """
    mean, products, shares = np.zeros(len(pull)), np.zeros((len(pull), len(pull))), np.zeros(len(begin))
    states = np.zeros((len(BELIEFS), len(begin)), np.uint8)
    states[::2] = begin
    likeliest = np.zeros(len(begin), np.uint8)
    _walk(
        np.ascontiguousarray(normal), np.ascontiguousarray(pull), groups, one_sided.astype(np.uint8), odds,
        neighbours(normal, groups), np.array(BELIEFS), states, steps, seed, mean, products, shares, likeliest,
    )  # fmt: skip
    kept = steps - int(BURN_IN * steps)
    return mean / kept, products / kept, shares / kept, likeliest.astype(np.bool_)


@compiled("i8(u1[::1], i8[::1], i8[::1])")
def _switched_on(state, groups, on):  # type: ignore[no-untyped-def]
    """Write the sizes that are on; return how many."""
    count = 0
    for index in range(len(groups)):
        if state[groups[index]] and count < MOST_ON:
            on[count] = index
            count += 1
    return count


@compiled("f8(f8, f8[:, ::1], f8[::1], u1[::1], f8[::1], u1[::1], i8[::1], i8, f8[:, ::1], f8[::1])")
def _probability(belief, normal, pull, one_sided, odds, state, on, count, factor, solved):  # type: ignore[no-untyped-def]
    """Return the log of a set's probability, the sizes integrated out; write the Cholesky factor L and L^-1 pull."""
    total = 0.0
    for effect in range(len(state)):
        total += odds[effect] if state[effect] else 0.0
    for i in range(count):
        for j in range(i + 1):
            value = belief * normal[on[i], on[j]] + (1.0 if i == j else 0.0)
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            factor[i, j] = np.sqrt(value) if i == j else value / factor[j, j]
        value = -belief * pull[on[i]]
        for k in range(i):
            value -= factor[i, k] * solved[k]
        solved[i] = value / factor[i, i]
        total += 0.5 * solved[i] ** 2 - np.log(factor[i, i]) + (np.log(2.0) if one_sided[on[i]] else 0.0)
    return total


@compiled("f8(f8, u1[::1], i8[::1], i8, f8[:, ::1], f8[::1], f8[::1])")
def _drawn(least, one_sided, on, count, factor, solved, drawn):  # type: ignore[no-untyped-def]
    """Draw the sizes of a set from their posterior; return the log probability that their signs are possible.

    Below `least` the set is rejected whatever the remaining sizes.
    """
    total = 0.0
    for i in range(count - 1, -1, -1):
        value = solved[i]
        for k in range(i + 1, count):
            value -= factor[k, i] * drawn[k]
        if one_sided[on[i]]:
            total += _log_positive(value)
            if total < least:
                break
            value = _positive(value)
        else:
            value += np.random.normal()
        drawn[i] = value / factor[i, i]
    return total


@inlined
def _drawn_at(least, belief, normal, pull, groups, one_sided, odds, state, on, factor, solved, drawn):  # type: ignore[no-untyped-def]
    """Draw the sizes of a set; return the log of its probability, corrected for the signs, and the number of sizes.

    Signs only reduce it, so a set already below `least` is rejected without drawing its sizes.
    """
    count = _switched_on(state, groups, on)
    total = _probability(belief, normal, pull, one_sided, odds, state, on, count, factor, solved)
    if total >= least:
        total += _drawn(least - total, one_sided, on, count, factor, solved, drawn)
    return total, count


@inlined
def _log_positive(mean):  # type: ignore[no-untyped-def]
    """Return the log of the probability that a normal of deviation 1 is positive."""
    if mean > FAR:
        return np.log(0.5 * erfc(-mean / np.sqrt(2.0)))
    return -0.5 * mean * mean - np.log(-mean * np.sqrt(2.0 * np.pi))


@inlined
def _positive(mean):  # type: ignore[no-untyped-def]
    """Draw from a normal of deviation 1, given that it is positive (C. P. Robert, Statistics and Computing 5, 1995)."""
    if mean > 0.0:
        value = mean + np.random.normal()
        while value <= 0.0:
            value = mean + np.random.normal()
        return value
    rate = 0.5 * (np.sqrt(mean * mean + 4.0) - mean)
    value = -np.log(1.0 - np.random.random()) / rate
    while np.log(1.0 - np.random.random()) > -0.5 * (value - mean - rate) ** 2:
        value = -np.log(1.0 - np.random.random()) / rate
    return value


@inlined
def _copy(state, to):  # type: ignore[no-untyped-def]
    """Copy a set by loops: slice assignment takes seconds to compile."""
    for effect in range(len(state)):
        to[effect] = state[effect]


@inlined
def _propose(state, edges, anywhere, to):  # type: ignore[no-untyped-def]
    """Write a neighbour of a set: one effect in or out, or both ends of an edge; the set itself if not `anywhere`."""
    _copy(state, to)
    effects = len(state)
    move = np.random.randint(0, effects + len(edges)) if anywhere else -1
    if move >= effects:
        for end in range(2):
            to[edges[move - effects, end]] ^= 1
    elif move >= 0:
        to[move] ^= 1


@inlined
def _swap(one, other, between):  # type: ignore[no-untyped-def]
    """Swap two sets by way of a third."""
    _copy(one, between)
    _copy(other, one)
    _copy(between, other)


@inlined
def _keep(sizes, on, drawn, count):  # type: ignore[no-untyped-def]
    sizes[:] = 0.0
    for i in range(count):
        sizes[on[i]] = drawn[i]


@inlined
def _add(state, sizes, mean, products, shares):  # type: ignore[no-untyped-def]
    """Add a state to the sums."""
    for effect in range(len(state)):
        shares[effect] += state[effect]
    for one in range(len(sizes)):
        if sizes[one] != 0.0:
            mean[one] += sizes[one]
            for other in range(len(sizes)):
                products[one, other] += sizes[one] * sizes[other]


@compiled(
    "void(f8[:, ::1], f8[::1], i8[::1], u1[::1], f8[::1], i8[:, ::1], f8[::1], u1[:, ::1], i8, i8,"
    "f8[::1], f8[:, ::1], f8[::1], u1[::1])"
)
def _walk(  # type: ignore[no-untyped-def]
    normal, pull, groups, one_sided, odds, edges, beliefs, states, steps, seed, mean, products, shares, likeliest
):
    """Walk; see `walk`, whose means are sums here. `states` are the sets that each walk begins with."""
    np.random.seed(seed)
    walks, effects, sizes = len(beliefs), states.shape[1], np.zeros(len(pull))
    here = np.full(walks, -np.inf)  # the start of a walk is always accepted
    on, drawn = np.empty(MOST_ON, np.int64), np.empty(MOST_ON)
    factor, solved = np.empty((MOST_ON, MOST_ON)), np.empty(MOST_ON)
    tried, settled, highest = np.empty(effects, np.uint8), int(BURN_IN * steps), -np.inf
    for step in range(steps):
        for number in range(walks):
            _propose(states[number], edges, step > 0, tried)
            least = here[number] + np.log(np.random.random())
            there, count = _drawn_at(
                least, beliefs[number], normal, pull, groups, one_sided, odds, tried, on, factor, solved, drawn
            )
            if there > least:
                _copy(tried, states[number])
                here[number] = there
                if number == 0:
                    _keep(sizes, on, drawn, count)
        cold = np.random.randint(0, walks - 1)
        belief, hot = beliefs[cold], beliefs[cold + 1]
        least = here[cold] + here[cold + 1] + np.log(np.random.random())
        up, _ = _drawn_at(-np.inf, hot, normal, pull, groups, one_sided, odds, states[cold], on, factor, solved, drawn)
        down, count = _drawn_at(
            least - up, belief, normal, pull, groups, one_sided, odds, states[cold + 1], on, factor, solved, drawn
        )
        if up + down > least:
            _swap(states[cold], states[cold + 1], tried)
            here[cold], here[cold + 1] = down, up
            if cold == 0:
                _keep(sizes, on, drawn, count)
        if here[0] > highest:
            highest = here[0]
            _copy(states[0], likeliest)
        if step >= settled:
            _add(states[0], sizes, mean, products, shares)
