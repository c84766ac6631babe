"""Simulate many candidates over a whole path at once, as fast as the structure of the problem allows.

Three facts make it fast, and none of them is an approximation beyond rounding:

* How the wheels answer depends on the motor (k2_over_k3, k1) alone. The candidates of one motor, which differ in
  base_width, share it; MOTORS motors are computed side by side.
* Heading is linear in z = 1 / base_width. Within a leg, a piece of path so short that no candidate turns by more than
  LARGEST_TURN, the way from the leg's start is a power series in iz whose real coefficients the candidates of a motor
  share: a point driven through at the heading A z adds its length times (iAz)^k / k! to the coefficient k.
* So is, over all poses of a leg, the sum of squared distances: with p the leg's start, u the direction of its middle
  heading, q_j(z) the series up to pose j, and r_j the pose as measured, the sum of |p + u q_j - r_j|^2 falls into sums
  over j of q_j, of q_j conj(r_j) and of |q_j|^2, which are series in z as well.

For each candidate it remains, once per leg, to rotate u and to evaluate the series. The points and their lengths are
those of the model's own step (two Gauss points per span), so the result is the model's.
"""

import numpy as np

from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import sincos
from cmr.model.paper import COEFFICIENTS, GAUSS, coefficients

MOTORS = 16  # computed side by side
LANES = 8  # base widths evaluated side by side
TERMS = 12  # of a series: the first left out is below 0.3^12 / 12! = 1e-15 of the way
SQUARE_TERMS = 7  # of |q|^2, in z^2, where the first left out is below 0.6^14 / 14! = 1e-14
# rad in a leg; headings then stay within 0.3 rad of the middle one. A single span may turn by up to 1 rad, where the
# model itself splits it: then 1e-12 of the way is left out.
LARGEST_TURN = 0.6
LONGEST_LEG = 32  # spans; the sums of squares lose digits where a leg is much longer than the distances

# Rows of one span in the trail of a leg; each row holds MOTORS numbers.
PSI_LEFT, PSI_RIGHT, ANGLE, LOWEST, HIGHEST = (row * MOTORS for row in range(5))
FIRST_LENGTH, SECOND_LENGTH, FIRST_ANGLE, SECOND_ANGLE, TRAIL = (row * MOTORS for row in range(5, 10))
# Where the series begin; coefficient k of a series is row k.
WAY, SUM, ALONG_X, ALONG_Y, SQUARE = (k * TERMS * MOTORS for k in range(5))
SERIES = (4 * TERMS + SQUARE_TERMS) * MOTORS
# Rows of a block of candidates; each row holds LANES numbers.
INVERSE_WIDTH, DIRECTION_X, DIRECTION_Y, X, Y, ERROR = (k * LANES for k in range(6))
BLOCK = 6 * LANES
DURATION = COEFFICIENTS * MOTORS  # where the response keeps the duration [s] it is for, behind its rows


@inlined
def _respond(response, radius, motors, duration):  # type: ignore[no-untyped-def]
    """Write the model's coefficients of a span of this duration for each motor, with 1 m of base width."""
    for i in range(MOTORS):
        rate = motors[0, i] * motors[1, i]
        numbers = coefficients(radius, 1.0 / motors[1, i], rate, radius, duration)
        for row in range(COEFFICIENTS):
            response[row * MOTORS + i] = numbers[row]


@compiled("void(f8[::1], f8[::1], f8[::1], f8, f8)")
def _roll(before, after, response, left, right):  # type: ignore[no-untyped-def]
    """Advance the wheels of all motors by one span: `moved` of cmr.model.paper, up to where the base width enters."""
    for i in range(MOTORS):
        final_left, final_right = left * response[i], right * response[i]
        psi_left, psi_right = before[PSI_LEFT + i], before[PSI_RIGHT + i]
        off_left, off_right = psi_left - final_left, psi_right - final_right
        off_sum, off_turn = off_left + off_right, off_right - off_left
        steady = response[5 * MOTORS + i] * (final_right - final_left)
        length = response[2 * MOTORS + i] * (final_left + final_right) + response[3 * MOTORS + i] * off_sum
        change = response[4 * MOTORS + i] * off_sum
        angle = before[ANGLE + i]
        middle = angle + (0.5 * steady + response[7 * MOTORS + i] * off_turn)
        half = GAUSS * steady + response[8 * MOTORS + i] * off_turn
        last = angle + (steady + response[6 * MOTORS + i] * off_turn)
        lowest, highest = before[LOWEST + i], before[HIGHEST + i]
        after[PSI_LEFT + i] = psi_left + off_left * response[MOTORS + i]
        after[PSI_RIGHT + i] = psi_right + off_right * response[MOTORS + i]
        after[ANGLE + i] = last
        after[LOWEST + i] = min(lowest, min(last, middle - abs(half)))
        after[HIGHEST + i] = max(highest, max(last, middle + abs(half)))
        after[FIRST_LENGTH + i] = 0.5 * (length - change)
        after[SECOND_LENGTH + i] = 0.5 * (length + change)
        after[FIRST_ANGLE + i] = middle - half
        after[SECOND_ANGLE + i] = middle + half


@inlined
def _turn(span):  # type: ignore[no-untyped-def]
    """Return the largest range of headings, times base width, covered by any of the motors [rad m]."""
    largest = 0.0
    for i in range(MOTORS):
        largest = max(largest, span[HIGHEST + i] - span[LOWEST + i])
    return largest


@compiled("i8(f8[::1], f8[::1], f8[:, ::1], f8, f8[::1], f8[::1], f8[::1], i8, i8, f8)")
def _leg(trail, response, motors, radius, left, right, dt, first, last, largest_turn):  # type: ignore[no-untyped-def]
    """Roll from span `first` on until a motor has turned by `largest_turn`; return the number of spans, at least 1."""
    spans = 0
    while spans < LONGEST_LEG and first + spans < last:
        k = first + spans
        if response[DURATION] != dt[k]:
            response[DURATION] = dt[k]
            _respond(response, radius, motors, dt[k])
        after = trail[(spans + 1) * TRAIL : (spans + 2) * TRAIL]
        _roll(trail[spans * TRAIL : (spans + 1) * TRAIL], after, response, left[k], right[k])
        if _turn(after) > largest_turn:
            return max(spans, 1)
        spans += 1
    return spans


@inlined
def _add_span(series, span, middle):  # type: ignore[no-untyped-def]
    """Add the displacement of one span to the series; headings count from `middle`."""
    for i in range(MOTORS):
        first, second = span[FIRST_LENGTH + i], span[SECOND_LENGTH + i]
        first_angle, second_angle = span[FIRST_ANGLE + i] - middle[i], span[SECOND_ANGLE + i] - middle[i]
        for k in range(TERMS):
            series[WAY + k * MOTORS + i] += first + second
            first *= first_angle * (1.0 / (k + 1))
            second *= second_angle * (1.0 / (k + 1))


@inlined
def _add_poses(series, poses, x, y):  # type: ignore[no-untyped-def]
    """Add the way so far to the sums over poses: `poses` of them lie here, and their coordinates sum to x and y."""
    for i in range(TERMS * MOTORS):
        way = series[WAY + i]
        series[SUM + i] += poses * way
        series[ALONG_X + i] += x * way
        series[ALONG_Y + i] += y * way


@inlined
def _add_squares(series, poses):  # type: ignore[no-untyped-def]
    """Add the square of the way so far, a series in z^2, for `poses` of them."""
    for i in range(MOTORS):
        c0, c1, c2 = series[i], series[MOTORS + i], series[2 * MOTORS + i]
        c3, c4, c5 = series[3 * MOTORS + i], series[4 * MOTORS + i], series[5 * MOTORS + i]
        c6, c7, c8 = series[6 * MOTORS + i], series[7 * MOTORS + i], series[8 * MOTORS + i]
        c9, c10, c11 = series[9 * MOTORS + i], series[10 * MOTORS + i], series[11 * MOTORS + i]
        series[SQUARE + i] += poses * (c0 * c0)
        series[SQUARE + MOTORS + i] += poses * (c1 * c1 - 2.0 * (c0 * c2))
        series[SQUARE + 2 * MOTORS + i] += poses * (c2 * c2 - 2.0 * (c1 * c3 - c0 * c4))
        series[SQUARE + 3 * MOTORS + i] += poses * (c3 * c3 - 2.0 * (c2 * c4 - c1 * c5 + c0 * c6))
        series[SQUARE + 4 * MOTORS + i] += poses * (c4 * c4 - 2.0 * (c3 * c5 - c2 * c6 + c1 * c7 - c0 * c8))
        series[SQUARE + 5 * MOTORS + i] += poses * (c5 * c5 - 2.0 * (c4 * c6 - c3 * c7 + c2 * c8 - c1 * c9 + c0 * c10))
        series[SQUARE + 6 * MOTORS + i] += poses * (c6 * c6 - 2.0 * (c5 * c7 - c4 * c8 + c3 * c9 - c2 * c10 + c1 * c11))


@compiled("f8(f8[::1], f8[::1], f8[::1], i8[::1], f8[::1], f8[::1], i8, i8, f8, f8)")
def _collect(series, trail, middle, pose_from, x, y, first, spans, centre_x, centre_y):  # type: ignore[no-untyped-def]
    """Fill the series of a leg; return the sum of squared distances of its poses from their centre."""
    scatter = 0.0
    for i in range(SERIES):
        series[i] = 0.0
    for k in range(spans):
        _add_span(series, trail[(k + 1) * TRAIL : (k + 2) * TRAIL], middle)
        poses = pose_from[first + k + 1] - pose_from[first + k]
        if poses > 0:
            sum_x, sum_y = 0.0, 0.0
            for pose in range(pose_from[first + k], pose_from[first + k + 1]):
                from_x, from_y = x[pose] - centre_x, y[pose] - centre_y
                sum_x += from_x
                sum_y += from_y
                scatter += from_x * from_x + from_y * from_y
            _add_poses(series, float(poses), sum_x, sum_y)
            _add_squares(series, float(poses))
    return scatter


@inlined
def _every_other(series, row):  # type: ignore[no-untyped-def]
    """Return every other coefficient of a series, as scalars, which stay in registers while used by many lanes."""
    return (
        series[row],
        series[row + 2 * MOTORS],
        series[row + 4 * MOTORS],
        series[row + 6 * MOTORS],
        series[row + 8 * MOTORS],
        series[row + 10 * MOTORS],
    )


@inlined
def _alternating(c, z):  # type: ignore[no-untyped-def]
    """Return c0 - c1 z + c2 z^2 - ..., what a series in iz gives with its even or odd coefficients and z squared."""
    return c[0] - z * (c[1] - z * (c[2] - z * (c[3] - z * (c[4] - z * c[5]))))


@inlined
def _squares(series, row):  # type: ignore[no-untyped-def]
    """Return the coefficients of the series of squares, as numbers."""
    return (
        series[row],
        series[row + MOTORS],
        series[row + 2 * MOTORS],
        series[row + 3 * MOTORS],
        series[row + 4 * MOTORS],
        series[row + 5 * MOTORS],
        series[row + 6 * MOTORS],
    )


@inlined
def _polynomial(c, z):  # type: ignore[no-untyped-def]
    """Return c0 + c1 z + c2 z^2 + ..."""
    return c[0] + z * (c[1] + z * (c[2] + z * (c[3] + z * (c[4] + z * (c[5] + z * c[6])))))


@inlined
def _nearest(lanes, block):  # type: ignore[no-untyped-def]
    """Return the smallest error of a block's candidates."""
    nearest = np.inf
    for lane in range(LANES):
        nearest = min(nearest, lanes[block * BLOCK + ERROR + lane])
    return nearest


@compiled("void(f8[::1], b1[::1], f8, f8[::1], i8, f8, f8, f8, f8, f8)")
def _advance(lanes, alive, turn, series, motor, poses, centre_x, centre_y, scatter, bound):  # type: ignore
    """Advance the candidates of one motor by a leg and add its squared distances to their errors.

    `turn` leads from the middle heading of the leg before to that of this one. Blocks of candidates whose errors all
    exceed `bound` are marked as not alive.
    """
    way_even, way_odd = _every_other(series, WAY + motor), _every_other(series, WAY + MOTORS + motor)
    sum_even, sum_odd = _every_other(series, SUM + motor), _every_other(series, SUM + MOTORS + motor)
    x_even, x_odd = _every_other(series, ALONG_X + motor), _every_other(series, ALONG_X + MOTORS + motor)
    y_even, y_odd = _every_other(series, ALONG_Y + motor), _every_other(series, ALONG_Y + MOTORS + motor)
    square = _squares(series, SQUARE + motor)
    for block in range(len(alive)):
        if not alive[block]:
            continue
        for lane in range(LANES):
            i = block * BLOCK + lane
            z = lanes[i + INVERSE_WIDTH]
            zz = z * z
            sine, cosine = sincos(turn * z)
            u_x = lanes[i + DIRECTION_X] * cosine - lanes[i + DIRECTION_Y] * sine
            u_y = lanes[i + DIRECTION_X] * sine + lanes[i + DIRECTION_Y] * cosine
            x, y = lanes[i + X], lanes[i + Y]
            from_x, from_y = x - centre_x, y - centre_y
            sum_x, sum_y = _alternating(sum_even, zz), z * _alternating(sum_odd, zz)
            along = from_x * sum_x + from_y * sum_y - (_alternating(x_even, zz) + z * _alternating(y_odd, zz))
            across = from_x * sum_y - from_y * sum_x - (z * _alternating(x_odd, zz) - _alternating(y_even, zz))
            error = poses * (from_x * from_x + from_y * from_y) + (scatter + _polynomial(square, zz))
            error += 2.0 * (u_x * along - u_y * across)
            way_x, way_y = _alternating(way_even, zz), z * _alternating(way_odd, zz)
            lanes[i + DIRECTION_X], lanes[i + DIRECTION_Y] = u_x, u_y
            lanes[i + X] = x + (u_x * way_x - u_y * way_y)
            lanes[i + Y] = y + (u_x * way_y + u_y * way_x)
            lanes[i + ERROR] += max(error, 0.0)  # rounding must not reduce it
        if bound < np.inf:
            alive[block] = _nearest(lanes, block) <= bound


@inlined
def _centre(pose_from, x, y, first, last):  # type: ignore[no-untyped-def]
    """Return the number of poses measured at the ends of spans [first, last) and the centre of them."""
    poses = pose_from[last] - pose_from[first]
    sum_x, sum_y = 0.0, 0.0
    for pose in range(pose_from[first], pose_from[last]):
        sum_x += x[pose]
        sum_y += y[pose]
    return float(poses), sum_x / max(poses, 1), sum_y / max(poses, 1)


@inlined
def _place(lanes, trail, carried, start):  # type: ignore[no-untyped-def]
    """Put every candidate at the start of a segment."""
    sine, cosine = sincos(start[0])
    for motor in range(MOTORS):
        carried[motor] = 0.0
        trail[PSI_LEFT + motor], trail[PSI_RIGHT + motor] = start[1], start[2]
        trail[ANGLE + motor], trail[LOWEST + motor], trail[HIGHEST + motor] = 0.0, 0.0, 0.0
        for block in range(0, lanes.shape[1], BLOCK):
            for i in range(block, block + LANES):
                lanes[motor, i + DIRECTION_X], lanes[motor, i + DIRECTION_Y] = cosine, sine
                lanes[motor, i + X], lanes[motor, i + Y] = 0.0, 0.0


@inlined
def _any(alive):  # type: ignore[no-untyped-def]
    for motor in range(alive.shape[0]):
        for block in range(alive.shape[1]):
            if alive[motor, block]:
                return True
    return False


@compiled(
    "void(f8[::1], f8[::1], f8[::1], i8[::1], f8[::1], f8[::1], i8[::1], f8[:, ::1], f8, f8[:, ::1], f8, f8, "
    "f8[:, ::1], b1[:, ::1])"
)
def add_squared_distances(  # type: ignore[no-untyped-def]
    left, right, dt, pose_from, x, y, segments, starts, radius, motors, largest_turn, bound, lanes, alive
):
    """Drive all segments with MOTORS motors times all base widths; add the squared distances to the errors in `lanes`.

    `left`, `right`, `dt` (T,) are the spans of all segments, one after the other; segment s has the spans
    segments[s] to segments[s + 1] and begins with starts[s]: theta, psi_left, psi_right. The poses measured at the end
    of span k are pose_from[k] to pose_from[k + 1] of `x`, `y`, which count from the segment's start. `motors`
    (2, MOTORS) holds k2_over_k3 and k1. `lanes` (MOTORS, B * BLOCK) are the candidates in blocks, with the inverse
    widths filled in; `largest_turn` is LARGEST_TURN times the smallest width. Blocks whose errors all exceed `bound`
    are given up and marked in `alive` (MOTORS, B).
    """
    trail, response = np.empty((LONGEST_LEG + 1) * TRAIL), np.empty(DURATION + 1)
    series, middle, carried = np.empty(SERIES), np.empty(MOTORS), np.empty(MOTORS)
    response[DURATION] = -1.0
    for segment in range(len(starts)):
        _place(lanes, trail, carried, starts[segment])
        k, end = segments[segment], segments[segment + 1]
        while k < end and _any(alive):
            spans = _leg(trail, response, motors, radius, left, right, dt, k, end, largest_turn)
            last = trail[spans * TRAIL : (spans + 1) * TRAIL]
            for i in range(MOTORS):
                middle[i] = 0.5 * (last[LOWEST + i] + last[HIGHEST + i])
            poses, centre_x, centre_y = _centre(pose_from, x, y, k, k + spans)
            scatter = _collect(series, trail, middle, pose_from, x, y, k, spans, centre_x, centre_y)
            for i in range(MOTORS):
                turn = carried[i] + middle[i]
                _advance(lanes[i], alive[i], turn, series, i, poses, centre_x, centre_y, scatter, bound)
                carried[i] = last[ANGLE + i] - middle[i]
                trail[PSI_LEFT + i], trail[PSI_RIGHT + i] = last[PSI_LEFT + i], last[PSI_RIGHT + i]
            k += spans
