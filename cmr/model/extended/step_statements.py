"""The statements of one step, of the initialisation and of a command's delay: the paper's, and those of effects.

The step, for a robot on a span of constant commands:

1. Commands become duties: stages `command` and `actuator`, with means over the step.
2. Wheel speeds: an exponential predictor and corrector. The paper's motor is solved exactly; what effects add counts as
   changing linearly from the step's beginning to its end (Cox and Matthews, J. Comput. Phys. 176, 2002, ETD2RK).
3. Dry friction keeps its direction within a step. A wheel that would reverse comes to rest on the way; from there it
   sticks, or sets off with what friction cannot hold.
4. Wheels, ground and body at the two Gauss-Legendre points; heading and position by collocation.

It has no branches: choices are conditional expressions, and all statements are assignments.
"""

from collections.abc import Iterable

from cmr.model.extended.statements import SIDES, Statements

CHANGED = (
    *("x", "y", "theta", "psi_left", "psi_right", "angle_left", "angle_right"),
    *("domega_left", "domega_right", "time"),
)
COEFFICIENTS = tuple(f"{what}_{when}" for when in ("first", "second", "end") for what in ("kept", "gained", "grown"))
LONGEST_STEP = 0.012  # s; longer spans are split into equal parts
FIRST, SECOND = 0.21132486540518713, 0.7886751345948129  # Gauss-Legendre points, as shares of a step
COLLOCATION = f"""\
FIRST, SECOND = {FIRST}, {SECOND}
first_BY_FIRST, first_BY_SECOND = 0.25, -0.038675134594812866
second_BY_FIRST, second_BY_SECOND = 0.5386751345948129, 0.25
end_BY_FIRST, end_BY_SECOND = 0.5, 0.5
"""
HELD = [f"duty_{side} = k1 * psi_{side}" for side in SIDES]  # the duties that hold the speeds where a drive begins
NOT_LATE = ["delay = 0.0", "lost = False"]  # a command without effects


def step_parts(statements: Statements) -> list[list[str]]:
    """Return the statements of one step, in parts that may become separate loops."""
    return [
        [
            "duty_left, duty_right = command_left, command_right",
            *statements.of("command"),
            *_both(_BEFORE),
            *statements.both("actuator"),
        ],
        [*_AHEAD, *statements.of("place")],
        [
            *_evaluation(statements),
            *_both(_DIRECTION),
            *statements.of("coupling"),
            *_both(_PREDICT),
            "load_before = load_share",
        ],
        [
            "sine, cosine = sine_ahead, cosine_ahead",
            *_evaluation(statements),
            *_both(_FRICTION),
            *statements.of("coupling"),
            "load_share = 0.5 * (load_before + load_share)",
        ],
        [*_both(_CORRECT), *statements.both("wheel")],
        _point(statements, "first"),
        _point(statements, "second"),
        _POSE,
        [*_both(("end_SIDE = after_SIDE",)), *_point(statements, "end")],
        [
            *_both(_AFTER),
            *statements.both("memory"),
            *statements.of("robot_memory"),
            "time = time + dt",
        ],
    ]


def _both(lines: Iterable[str]) -> list[str]:
    return [line for side in SIDES for line in _each(lines, side)]


def _each(lines: Iterable[str], side: str) -> list[str]:
    return [line.replace("_SIDE", f"_{side}") for line in lines]


def _evaluation(statements: Statements) -> list[str]:
    """Return the lines that compute accelerations without friction, and friction, from wheel speeds."""
    lines = [
        "load_share = max(0.0, duty_left * (duty_left - 0.8 * k1 * psi_left)) "
        "+ max(0.0, duty_right * (duty_right - 0.8 * k1 * psi_right))"
    ]
    for before, stage in (
        (["voltage_SIDE = duty_SIDE"], "voltage"),
        (["current_SIDE = voltage_SIDE - back_emf_SIDE * psi_SIDE"], "current"),
        (
            ["acceleration_SIDE = gain_SIDE * current_SIDE", "friction_SIDE = 0.0", "break_away_SIDE = 0.0"],
            "acceleration",
        ),
    ):
        lines += [*_each(before, "left"), *_each(before, "right"), *statements.both(stage)]
    return lines


def _point(statements: Statements, point: str) -> list[str]:
    """Return the lines that compute the body's motion at a Gauss point."""
    sides = [line.replace("POINT", point) for side in SIDES for line in _each(_GROUND, side)]
    return [
        *sides,
        *statements.both("ground"),
        "difference = radius_right * rolling_right - radius_left * rolling_left",
        "width = base_width",
        *statements.of("width"),
        "speed = 0.5 * (radius_left * rolling_left + radius_right * rolling_right)",
        "sideways = 0.0",
        "yaw_rate = difference / width",
        *statements.of("body"),
        f"speed_{point}, sideways_{point}, yaw_rate_{point} = speed, sideways, yaw_rate",
    ]


_BEFORE = (
    "before_SIDE, angle_before_SIDE = psi_SIDE, angle_SIDE",
    "duty_SIDE, gain_SIDE, back_emf_SIDE = duty_SIDE, k2_over_k3, k1",
)
_AHEAD = (
    "rate = k1 * k2_over_k3",
    "sine, cosine = sincos(theta)",
    "turned_ahead = dt * wheel_radius * (psi_right - psi_left) / base_width",
    "sine_ahead, cosine_ahead = sincos(theta + turned_ahead)",
    "half_ahead = 0.25 * dt * wheel_radius * (psi_left + psi_right)",
    "x_ahead = x + half_ahead * (cosine + cosine_ahead)",
    "y_ahead = y + half_ahead * (sine + sine_ahead)",
)
_DIRECTION = (
    "direction_SIDE = sign(acceleration_SIDE) if before_SIDE == 0.0 else sign(before_SIDE)",
    "hold_SIDE = break_away_SIDE if before_SIDE == 0.0 else 0.0",
    "free_SIDE = 0.0 if abs(acceleration_SIDE) <= hold_SIDE else 1.0",
    # Without friction a wheel at rest is free even if nothing drives it.
    "free_SIDE = free_SIDE if break_away_SIDE > 0.0 else 1.0",
    "acceleration_SIDE = free_SIDE * (acceleration_SIDE - direction_SIDE * friction_SIDE)",
)
_PREDICT = (
    "source_SIDE = acceleration_SIDE + rate * before_SIDE",
    "ahead_SIDE = kept_end * before_SIDE + gained_end * source_SIDE",
    "psi_SIDE = ahead_SIDE",
)
_FRICTION = (
    "driving_SIDE = acceleration_SIDE",
    "acceleration_SIDE = free_SIDE * (acceleration_SIDE - direction_SIDE * friction_SIDE)",
)
_CORRECT = (
    "change_SIDE = acceleration_SIDE + rate * ahead_SIDE - source_SIDE",
    "after_SIDE = ahead_SIDE + grown_end * change_SIDE",
    "first_SIDE = kept_first * before_SIDE + gained_first * source_SIDE + grown_first * change_SIDE",
    "second_SIDE = kept_second * before_SIDE + gained_second * source_SIDE + grown_second * change_SIDE",
    "domega_first_SIDE = source_SIDE + FIRST * change_SIDE - rate * first_SIDE",
    "domega_second_SIDE = source_SIDE + SECOND * change_SIDE - rate * second_SIDE",
    "domega_end_SIDE = source_SIDE + change_SIDE - rate * after_SIDE",
    # A wheel reversed by friction: at rest after the share `until` of the step, then stuck, or accelerated in the other
    # direction with the `part` of its acceleration left by friction. The change in speed grows from then on: at the
    # Gauss points it is replaced by the best-fitting straight line, so vanishing friction changes almost nothing.
    "reverses_SIDE = direction_SIDE * after_SIDE < 0.0",
    "reverses_SIDE = reverses_SIDE & (break_away_SIDE > 0.0)",
    "until_SIDE = before_SIDE / (before_SIDE - after_SIDE)",
    "onward_SIDE = driving_SIDE + direction_SIDE * break_away_SIDE",
    "part_SIDE = min(1.0, onward_SIDE / (driving_SIDE - direction_SIDE * friction_SIDE))",
    "part_SIDE = 0.0 if abs(driving_SIDE) <= break_away_SIDE else part_SIDE",
    "braked_SIDE = (part_SIDE - 1.0) * after_SIDE",
    "mean_SIDE = 0.5 * braked_SIDE * (1.0 - until_SIDE)",
    "slope_SIDE = 2.0 * mean_SIDE * (1.0 + 2.0 * until_SIDE)",
    "after_SIDE = after_SIDE + braked_SIDE if reverses_SIDE else after_SIDE",
    "first_SIDE = first_SIDE + mean_SIDE + (FIRST - 0.5) * slope_SIDE if reverses_SIDE else first_SIDE",
    "second_SIDE = second_SIDE + mean_SIDE + (SECOND - 0.5) * slope_SIDE if reverses_SIDE else second_SIDE",
    "slowing_SIDE = braked_SIDE / dt",
    "domega_first_SIDE = domega_first_SIDE + slowing_SIDE if reverses_SIDE else domega_first_SIDE",
    "domega_second_SIDE = domega_second_SIDE + slowing_SIDE if reverses_SIDE else domega_second_SIDE",
    "domega_end_SIDE = part_SIDE * domega_end_SIDE if reverses_SIDE else domega_end_SIDE",
    "turned_SIDE = 0.5 * dt * (first_SIDE + second_SIDE)",
)
_GROUND = (
    "psi_SIDE, domega_SIDE = POINT_SIDE, domega_POINT_SIDE",
    "angle_SIDE = angle_before_SIDE + dt * (POINT_BY_FIRST * first_SIDE + POINT_BY_SECOND * second_SIDE)",
    "radius_SIDE, rolling_SIDE = wheel_radius, psi_SIDE",
)
_POSE = [
    "sine_first, cosine_first = sincos(theta + dt * (0.25 * yaw_rate_first + first_BY_SECOND * yaw_rate_second))",
    "sine_second, cosine_second = sincos(theta + dt * (second_BY_FIRST * yaw_rate_first + 0.25 * yaw_rate_second))",
    "x = x + 0.5 * dt * (speed_first * cosine_first - sideways_first * sine_first "
    "+ speed_second * cosine_second - sideways_second * sine_second)",
    "y = y + 0.5 * dt * (speed_first * sine_first + sideways_first * cosine_first "
    "+ speed_second * sine_second + sideways_second * cosine_second)",
    "theta = theta + 0.5 * dt * (yaw_rate_first + yaw_rate_second)",
]
_AFTER = (
    "psi_SIDE, domega_SIDE = after_SIDE, domega_end_SIDE",
    "angle_SIDE = angle_before_SIDE + turned_SIDE",
)
