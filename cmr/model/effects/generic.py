"""Generic terms: sums of products of command, speed, yaw rate and heading, without a physical cause.

They are not entries of the catalogue and are never named. If a robot does what no entry describes, the diagnosis may
give some of them a coefficient, so that the simulation predicts better what it cannot explain. Each coefficient is a
normal parameter, 0.0 by default, which switches the product off exactly.

Of a wheel, products are of the duty `u` and of the share of the no-load speed `s` = K1 psi, so coefficients are duties
and comparable between robots. For the body, they are of its speed v [m/s], its yaw rate omega [rad/s] and its heading
in the world, with coefficients in the corresponding units. Products already in the catalogue (v omega in the sideways
speed: lateral_skid) are omitted, and so are wheel angle and position, whose terms do not transfer to other drives.
"""

from cmr.model.effect import GENERIC, Effect
from cmr.model.parameters import ParameterDefinition

LARGEST = 1e3  # of a coefficient: a bound that is never reached
SMALL = 0.03  # typical size of those that have no unit

Product = tuple[str, str, str, float]  # end of the parameter's name, unit, the product in words, typical size


def _generic(
    name: str, moves: str, equations: dict[str, str], products: tuple[Product, ...], needs: str, shows_in: str
) -> Effect:
    """Return an effect that is a sum of products, each with its own coefficient; `moves` says what it acts on."""
    return Effect(
        name=name,
        group=GENERIC,
        cause=f"A generic term, no physical cause, {moves}.",
        equations=equations,
        parameters=tuple(
            ParameterDefinition(f"{name}_{product}", unit, f"coefficient of {words}", -LARGEST, LARGEST, 0.0, typical)
            for product, unit, words, typical in products
        ),
        needs=needs,
        shows_in=shows_in,
    )


WHEEL = _generic(
    name="generic_drive",
    moves="drives the wheels",
    equations={
        "actuator": """
            effort = abs(duty)
            by_duty = effort * (generic_drive_abs_u + duty * generic_drive_u_abs_u) + generic_drive_u_cubed * duty**3
        """,
        "voltage": """
            s = k1 * psi
            by_speed = s * (abs(s) * generic_drive_s_abs_s + s * s * generic_drive_s_cubed)
            crossed = generic_drive_s_abs_u * s * effort + generic_drive_u_abs_s * duty * abs(s)
            voltage = voltage + by_duty + by_speed + crossed
        """,
    },
    products=(
        ("abs_u", "-", "abs(duty) in the motor's duty", SMALL),
        ("u_abs_u", "-", "duty abs(duty) in the motor's duty", SMALL),
        ("u_cubed", "-", "duty^3 in the motor's duty", SMALL),
        ("s_abs_s", "-", "s abs(s) in the motor's duty, s = K1 psi", SMALL),
        ("s_cubed", "-", "s^3 in the motor's duty, s = K1 psi", SMALL),
        ("s_abs_u", "-", "s abs(duty) in the motor's duty, s = K1 psi", SMALL),
        ("u_abs_s", "-", "duty abs(s) in the motor's duty, s = K1 psi", SMALL),
    ),
    needs="duties and speeds of all sizes, both ways",
    shows_in="wheel speeds",
)

BODY = _generic(
    name="generic_motion",
    moves="moves the body",
    equations={
        "place": """
            cosine = cos(theta)
            sine = sin(theta)
        """,
        "body": """
            v, abs_v, w, abs_w = speed, abs(speed), yaw_rate, abs(yaw_rate)
            turn = generic_motion_turn_abs_v * abs_v + generic_motion_turn_w_abs_w * w * abs_w
            turn = turn + v * (generic_motion_turn_v_cos * cosine + generic_motion_turn_v_sin * sine)
            turn = turn + v * (generic_motion_turn_v_abs_v * abs_v + generic_motion_turn_v_w * w)
            yaw_rate = yaw_rate + turn + generic_motion_turn_w_abs_v * w * abs_v
            on = abs_w * (generic_motion_on_abs_w + generic_motion_on_w_squared * abs_w)
            speed = speed + on + v * (generic_motion_on_v_abs_w * abs_w + generic_motion_on_v_abs_v * abs_v)
            aside = generic_motion_aside_v * v + generic_motion_aside_w_abs_w * w * abs_w
            drift = generic_motion_aside_abs_v_cos * cosine + generic_motion_aside_abs_v_sin * sine
            drift = drift + generic_motion_aside_abs_v + generic_motion_aside_w_abs_v * w
            sideways = sideways + aside + drift * abs_v
        """,
    },
    products=(
        ("turn_abs_v", "rad/m", "abs(v) in the turn rate", 0.1),
        ("turn_v_abs_v", "rad s/m^2", "v abs(v) in the turn rate", 0.2),
        ("turn_v_w", "s/m", "v omega in the turn rate", 0.1),
        ("turn_w_abs_v", "s/m", "omega abs(v) in the turn rate", 0.1),
        ("turn_w_abs_w", "s/rad", "omega abs(omega) in the turn rate", 0.02),
        ("turn_v_cos", "rad/m", "v cos(theta) in the turn rate", 0.1),
        ("turn_v_sin", "rad/m", "v sin(theta) in the turn rate", 0.1),
        ("on_abs_w", "m/rad", "abs(omega) in the forward speed", 0.005),
        ("on_w_squared", "m s/rad^2", "omega^2 in the forward speed", 0.003),
        ("on_v_abs_w", "s/rad", "v abs(omega) in the forward speed", 0.02),
        ("on_v_abs_v", "s/m", "v abs(v) in the forward speed", 0.05),
        ("aside_v", "-", "v in the speed to the left", SMALL),
        ("aside_abs_v", "-", "abs(v) in the speed to the left", SMALL),
        ("aside_w_abs_v", "s/rad", "omega abs(v) in the speed to the left", 0.02),
        ("aside_w_abs_w", "m s/rad^2", "omega abs(omega) in the speed to the left", 0.003),
        ("aside_abs_v_cos", "-", "abs(v) cos(theta) in the speed to the left", SMALL),
        ("aside_abs_v_sin", "-", "abs(v) sin(theta) in the speed to the left", SMALL),
    ),
    needs="speeds, turns and headings of all kinds",
    shows_in="the pose and the gyro",
)

EFFECTS = (WHEEL, BODY)
