"""The paper's model, compiled: one step of many robots, or one drive under many candidate parameters.

Over a span of constant duty the wheel speed is f + d e^(-rate t), with f the final speed and d the distance from it,
so wheel angles and heading are known exactly. The position integrates speed times direction with the two-point
Gauss-Legendre rule. Everything that does not depend on the state is in nine coefficients, computed once.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import exp, expm1, expm1_small, sincos, sincos_small, sinh_and_cosh_minus_1

Array: TypeAlias = NDArray[np.float64]
GAUSS = 0.28867513459481287  # the two points lie this share of a span before and after its middle
COEFFICIENTS = 9
SHORT_SPAN = 0.69  # time constants
LANES = 16  # candidates that advance side by side
WIDTH = 4  # numbers in a vector: lanes beyond the last candidate fill up to a multiple of it
# Rows of LANES numbers in the work space of a drive: the nine coefficients, then these.
K0, K1, K2, K3, K4, K5, K6, K7, K8, RADIUS, FINAL, GAIN, RATE, TURNING = (row * LANES for row in range(14))
X, Y, THETA, PSI_LEFT, PSI_RIGHT, ANGLE_LEFT, ANGLE_RIGHT, ROWS = (row * LANES for row in range(14, 22))
RECORDED = 7  # rows from X on that a drive records


@inlined
def coefficients(radius: float, final: float, rate: float, turning: float, h: float):  # type: ignore[no-untyped-def]
    """Return the nine numbers that `moved` needs for a span of `h` [s].

    `final` is the wheel speed at full duty, `rate` one over the time constant, `turning` radius over base width.
    """
    middle = expm1(-0.5 * h * rate)
    to_first, to_second = expm1(GAUSS * h * rate), expm1(-GAUSS * h * rate)
    sinh, cosh_minus_1 = 0.5 * (to_first - to_second), 0.5 * (to_first + to_second)
    return _coefficients(radius, final, rate, turning, h, middle, sinh, cosh_minus_1)


@inlined
def coefficients_of_short_span(radius: float, final: float, rate: float, turning: float, h: float):  # type: ignore[no-untyped-def]
    """Return the same in a third of the time where `rate` times `h` is at most SHORT_SPAN."""
    sinh, cosh_minus_1 = sinh_and_cosh_minus_1(GAUSS * h * rate)
    return _coefficients(radius, final, rate, turning, h, expm1_small(-0.5 * h * rate), sinh, cosh_minus_1)


@inlined
def _coefficients(radius, final, rate, turning, h, middle, sinh, cosh_minus_1):  # type: ignore[no-untyped-def]
    """Return the coefficients from e^(-rate t) - 1 at the middle and what takes it from there to the Gauss points."""
    kept = 1.0 + middle
    both = middle + kept * cosh_minus_1
    whole = middle * (2.0 + middle)
    per_rate = -turning / rate
    return (
        final,
        whole,
        0.5 * h * radius,
        0.5 * h * radius * (1.0 + both),
        -0.5 * h * radius * kept * sinh,
        h * turning,
        per_rate * whole,
        per_rate * both,
        -per_rate * kept * sinh,
    )


@inlined
def moved(theta, psi_left, psi_right, left, right, near):  # type: ignore[no-untyped-def]
    """Return dx, dy [m], the turn [rad] and both new wheel speeds after a span of constant duties."""
    k0, k1, k2, k3, k4, k5, k6, k7, k8 = near
    final_left, final_right = left * k0, right * k0
    off_left, off_right = psi_left - final_left, psi_right - final_right
    final_turn, off_turn, off_sum = final_right - final_left, off_right - off_left, off_left + off_right
    speed, change = k2 * (final_left + final_right) + k3 * off_sum, k4 * off_sum
    steady = k5 * final_turn
    sine, cosine = sincos(theta + (0.5 * steady + k7 * off_turn))
    half_sine, half_cosine = sincos_small(GAUSS * steady + k8 * off_turn)
    along, across = speed * half_cosine, change * half_sine
    dx, dy = along * cosine - across * sine, along * sine + across * cosine
    return dx, dy, steady + k6 * off_turn, psi_left + off_left * k1, psi_right + off_right * k1


@compiled("void(f8[:, :], f8, f8[:, :])")
def fill_coefficients(parameters: Array, h: float, rows: Array) -> None:
    """Write each robot's coefficients for spans of `h` [s] into the rows (9, robots); parameters (4, robots)."""
    for i in range(parameters.shape[1]):
        radius, gain, k1, base = parameters[0, i], parameters[1, i], parameters[2, i], parameters[3, i]
        numbers = coefficients(radius, 1.0 / k1, gain * k1, radius / base, h)
        for row in range(COEFFICIENTS):
            rows[row, i] = numbers[row]


@compiled("void(" + ", ".join(["f8[::1]"] * 16) + ")")
def advance(x, y, theta, psi_left, psi_right, left, right, k0, k1, k2, k3, k4, k5, k6, k7, k8):  # type: ignore[no-untyped-def]
    """Let one span of constant duties pass for all robots, in place."""
    for i in range(len(x)):
        near = k0[i], k1[i], k2[i], k3[i], k4[i], k5[i], k6[i], k7[i], k8[i]
        dx, dy, turn, psi_left[i], psi_right[i] = moved(theta[i], psi_left[i], psi_right[i], left[i], right[i], near)
        x[i] += dx
        y[i] += dy
        theta[i] += turn


@compiled("void(f8[::1])")
def wrap(theta: Array) -> None:
    """Turn headings by whole turns into (-pi, pi], in place."""
    for i in range(len(theta)):
        wrapped = theta[i] - 2.0 * np.pi * np.ceil((theta[i] - np.pi) / (2.0 * np.pi))
        theta[i] = wrapped if wrapped > -np.pi else np.pi


@compiled("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def read(state: Array, duty: Array, parameters: Array, states: Array) -> None:
    """Write the fields of RobotState (7, robots): headings in (-pi, pi], accelerations those at the present duties.

    `state` (5, ...), `duty` (2, ...) and `parameters` (4, ...) may have columns of more robots.
    """
    n = states.shape[1]
    for row in range(5):
        for i in range(n):  # slices would take seconds to compile
            states[row, i] = state[row, i]
    wrap(states[2])
    for side in range(2):
        domega, duties, psi = states[5 + side], duty[side], states[3 + side]
        for i in range(n):
            domega[i] = parameters[1, i] * (duties[i] - parameters[2, i] * psi[i])


@compiled("void(f8[::1], f8[::1], f8[:, ::1], f8[::1], f8[:, ::1])")
def wheel_speeds(duty: Array, dt: Array, parameters: Array, psi: Array, speeds: Array) -> None:
    """Fill `speeds` (T + 1, candidates) of one side from speeds `psi`; parameters (4, candidates)."""
    kept = np.empty(len(psi))
    final = 1.0 / parameters[2]
    rate = parameters[1] * parameters[2]
    speeds[0] = psi
    for k in range(len(dt)):
        if k == 0 or dt[k] != dt[k - 1]:
            for i in range(len(psi)):
                kept[i] = exp(-rate[i] * dt[k])
        before, after = speeds[k], speeds[k + 1]
        for i in range(len(psi)):
            after[i] = duty[k] * final[i] + (before[i] - duty[k] * final[i]) * kept[i]


@inlined
def _load(work, parameters, start, first, lanes):  # type: ignore[no-untyped-def]
    """Fill the work space for `lanes` candidates from `first` on; the lanes left over repeat the last of them."""
    for i in range(LANES):
        candidate = first + min(i, lanes - 1)
        radius, gain, k1, base = (
            parameters[0, candidate],
            parameters[1, candidate],
            parameters[2, candidate],
            parameters[3, candidate],
        )
        work[RADIUS + i], work[FINAL + i], work[GAIN + i] = radius, 1.0 / k1, gain
        work[RATE + i], work[TURNING + i] = gain * k1, radius / base
        work[ANGLE_LEFT + i], work[ANGLE_RIGHT + i] = 0.0, 0.0
        for row in range(5):
            work[X + row * LANES + i] = start[row, candidate]


@inlined
def _prepare(w, width, h):  # type: ignore[no-untyped-def]
    """Compute the coefficients for spans of `h` [s]."""
    fastest = 0.0
    for i in range(width):
        fastest = max(fastest, w[RATE + i])
    if h * fastest <= SHORT_SPAN:
        for i in range(width):
            _keep(w, i, coefficients_of_short_span(w[RADIUS + i], w[FINAL + i], w[RATE + i], w[TURNING + i], h))
    else:
        for i in range(width):
            _keep(w, i, coefficients(w[RADIUS + i], w[FINAL + i], w[RATE + i], w[TURNING + i], h))


@inlined
def _keep(w, i, near):  # type: ignore[no-untyped-def]
    w[K0 + i], w[K1 + i], w[K2 + i], w[K3 + i], w[K4 + i], w[K5 + i], w[K6 + i], w[K7 + i], w[K8 + i] = near


@inlined
def _span(w, width, left, right, h):  # type: ignore[no-untyped-def]
    """Let one span pass for the candidates in the work space."""
    for i in range(width):
        near = w[K0 + i], w[K1 + i], w[K2 + i], w[K3 + i], w[K4 + i], w[K5 + i], w[K6 + i], w[K7 + i], w[K8 + i]
        psi_left, psi_right = w[PSI_LEFT + i], w[PSI_RIGHT + i]
        dx, dy, turn, new_left, new_right = moved(w[THETA + i], psi_left, psi_right, left, right, near)
        w[X + i] += dx
        w[Y + i] += dy
        w[THETA + i] += turn
        # domega = gain (duty - k1 psi), integrated over the span, gives the angle.
        seconds = 1.0 / w[GAIN + i]
        w[ANGLE_LEFT + i] += w[FINAL + i] * (left * h - (new_left - psi_left) * seconds)
        w[ANGLE_RIGHT + i] += w[FINAL + i] * (right * h - (new_right - psi_right) * seconds)
        w[PSI_LEFT + i] = new_left
        w[PSI_RIGHT + i] = new_right


@compiled(
    "void(f8[::1], f8[::1], f8[::1], i8[::1], f8[:, ::1], f8[:, ::1], i8[::1], "
    + ", ".join(["f8[:, ::1]"] * RECORDED)
    + ")"
)
def drive(  # type: ignore[no-untyped-def]
    left, right, dt, parts, parameters, start, at, x, y, theta, psi_left, psi_right, angle_left, angle_right
):
    """Drive T spans with every candidate and record the states at the borders `at`.

    Shapes: left, right, dt and parts (T,), parts saying in how many equal parts each span is integrated; parameters
    (4, candidates); start (5, candidates); at (R,), ascending; the recorded arrays (R, candidates).
    """
    work = np.zeros(ROWS)
    candidates = parameters.shape[1]
    for first in range(0, candidates, LANES):
        lanes = min(candidates - first, LANES)
        width = (lanes + WIDTH - 1) // WIDTH * WIDTH
        _load(work, parameters, start, first, lanes)
        prepared = -1.0
        border = 0
        for r in range(len(at)):
            while border < at[r]:
                h = dt[border] / parts[border]
                if h != prepared:
                    _prepare(work, width, h)
                    prepared = h
                for _ in range(parts[border]):
                    _span(work, width, left[border], right[border], h)
                border += 1
            for i in range(lanes):
                x[r, first + i] = work[X + i]
                y[r, first + i] = work[Y + i]
                theta[r, first + i] = work[THETA + i]
                psi_left[r, first + i] = work[PSI_LEFT + i]
                psi_right[r, first + i] = work[PSI_RIGHT + i]
                angle_left[r, first + i] = work[ANGLE_LEFT + i]
                angle_right[r, first + i] = work[ANGLE_RIGHT + i]
