"""Variables and functions of formulas, each with its unit and meaning."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Variable:
    """A variable of formulas. `small` is the size below which a smoothed sign of it fades to 0.

    A `slow` variable is constant within a step.
    """

    unit: str
    meaning: str
    small: float
    slow: bool = False


@dataclass(frozen=True)
class Function:
    """A function of formulas: how many arguments it has, and what it does.

    `constants` is how many of the last arguments must be constants or numbers.
    """

    arguments: int
    meaning: str
    constants: int = 0


VARIABLES = {
    "v": Variable("m/s", "forward speed, as the wheels say it", 0.01),
    "w": Variable("rad/s", "yaw rate, as the wheels say it", 0.02),
    "dv": Variable("m/s^2", "forward acceleration, as the wheels say it", 0.05),
    "dw": Variable("rad/s^2", "yaw acceleration, as the wheels say it", 0.1),
    "psi": Variable("rad/s", "speed of the wheel", 0.2),
    "other_psi": Variable("rad/s", "speed of the wheel on the other side", 0.2),
    "domega": Variable("rad/s^2", "acceleration of the wheel", 1.0),
    "other_domega": Variable("rad/s^2", "acceleration of the wheel on the other side", 1.0),
    "u": Variable("-", "duty of the motor", 0.01),
    "other_u": Variable("-", "duty of the motor on the other side", 0.01),
    "s": Variable("-", "K1 psi: the duty that holds the wheel's speed", 0.01),
    "effort": Variable("-", "u - K1 psi: the duty that accelerates the wheel", 0.01),
    "load": Variable("-", "current drawn: sum over both sides of max(0, u (u - 0.8 K1 psi))", 0.01),
    "theta": Variable("rad", "heading", 0.01, slow=True),
    "x": Variable("m", "place", 0.01, slow=True),
    "y": Variable("m", "place", 0.01, slow=True),
    "t": Variable("s", "time since the start", 0.01, slow=True),
    "charge": Variable("s", "charge drawn since the start: load times time", 0.01, slow=True),
    "since_turn": Variable("s", "time since the turn reversed", 0.01, slow=True),
    "way_since_turn": Variable("m", "distance driven since the turn reversed", 0.01, slow=True),
}
FUNCTIONS = {
    "abs": Function(1, "size"),
    "sign": Function(1, "sign of a variable, smoothed: a / sqrt(a^2 + e^2), where the small e belongs to the variable"),
    "tanh": Function(1, "hyperbolic tangent"),
    "sin": Function(1, "sine"),
    "cos": Function(1, "cosine"),
    "exp": Function(1, "exponential; arguments above 30 count as 30"),
    "clip": Function(2, "the first argument, but no larger than the second either way", constants=1),
    "dead_zone": Function(2, "what the first argument exceeds the second by, either way", constants=1),
    "step": Function(2, "1 where the first argument is larger than the second, else 0", constants=1),
    "disc": Function(3, "1 within a disc on the floor, else 0: centre x and y, radius", constants=3),
    "low_pass": Function(2, "the first argument, smoothed with the time constant that is the second", constants=1),
}
LARGEST_EXPONENT = 30.0  # of exp: an absurd constant must not make a robot's state infinite
TURNING = 0.02  # rad/s of yaw rate; slower rotation does not reverse a turn
