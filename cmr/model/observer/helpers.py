"""What the compiled observer's loops count with, as text: constants, and functions that are compiled into them."""

HELPERS = '''

NEARBY = 1e-3  # m
EARLY = 1e-3  # of a step: smaller differences between times do not count
# Duty; a step is split for larger changes, and takes the mean command for smaller ones. For a change D at the share s
# of a step dt, the mean puts the angle of a wheel k2_over_k3 D dt^2 s (1 - s) / 2 off: 3e-5 rad.
SMALL = 0.02
SPLIT, FIRST, LAST = 0, 1, 3  # columns of a profile of commands; left, with right behind it
# What is kept of each step behind the pose: the share after which it was split, the mean yaw rate before that and by
# how much it grew there, then the same behind, then how much it curved before and behind: parabolas.
SPLIT_AT, MEAN_BEFORE, GROWTH_BEFORE, MEAN, GROWTH, CURVE_BEFORE, CURVE, KEPT_OF_STEPS = 3, 4, 5, 6, 7, 8, 9, 10
TWELFTH = 1.0 / 12.0
STEEP = 1.7320508075688772  # from two Gauss points to the ends of a step, a line grows by so many times as much


@inlined
def place(step, mask):
    """Return where the past has this step: unsigned, or each access would take a negative one to count from the end."""
    return np.uint64(step & mask)


@inlined
def prepare_parts(here, shares, dt, parts, before, behind):
    """Keep the coefficients of a block for steps of these shares of dt, and for the rest of it; `parts` is overwritten.

    Numbers are copied one by one here and below: a slice that is assigned takes seconds to compile.
    """
    for i in range(LANES):
        parts[i] = (1.0 - shares[i]) * dt
    prepare_each(here, parts)
    for i in range(len(behind)):
        behind[i] = here[DT + i]
    for i in range(LANES):
        parts[i] = shares[i] * dt
    prepare_each(here, parts)
    for i in range(len(before)):
        before[i] = here[DT + i]


@inlined
def put_coefficients(kept, here):
    """Put coefficients that were kept back into their block."""
    for i in range(len(kept)):
        here[DT + i] = kept[i]


@inlined
def known(duty, held):
    """Return a duty, or where it is not known, as before the first command, that which held the speed at the start."""
    return held if np.isnan(duty) else duty


@inlined
def beside_line(step, lane, share, dt):
    """Return by how much the heading at a share of a step lies beside the line between its ends [rad]."""
    if not 0.0 < share < 1.0:
        return 0.0
    split = step[SPLIT_AT, lane]
    if share < split:
        along, part, growth = share / split, split, step[GROWTH_BEFORE, lane]
        beside = along
    else:
        along, part, growth = (share - split) / (1.0 - split), 1.0 - split, step[GROWTH, lane]
        beside = 1.0 - along
    beside *= split * (1.0 - split) * (step[MEAN_BEFORE, lane] - step[MEAN, lane]) if split > 0.0 else 0.0
    return dt * (beside - 0.5 * part * growth * along * (1.0 - along))


@inlined
def yaw_rate_within(step, lane, share):
    """Return the yaw rate at a share of a step, without what corrections add [rad/s]."""
    split = step[SPLIT_AT, lane]
    if split > 0.0 and share <= split + EARLY:
        off = share / split - 0.5
        rate = step[MEAN_BEFORE, lane] + off * step[GROWTH_BEFORE, lane]
        return rate + (off * off - TWELFTH) * step[CURVE_BEFORE, lane]
    off = (share - split) / (1.0 - split) - 0.5
    return step[MEAN, lane] + off * step[GROWTH, lane] + (off * off - TWELFTH) * step[CURVE, lane]
'''
