"""Convert a law to statements for the stages of the model's step, for compilation like any other effect.

Its own names begin with an underscore, which no effect uses, so that names of two laws cannot collide.
"""

from collections.abc import Iterator

from cmr.model.effect import Memory
from cmr.model.laws.law import Law
from cmr.model.laws.tree import Part
from cmr.model.laws.words import LARGEST_EXPONENT, TURNING, VARIABLES
from cmr.model.stages import STAGES

BEFORE = "place"  # stage for values computed once per step
OF_A_SIDE = ("psi", "other_psi", "domega", "other_domega", "u", "other_u", "s", "effort")
# Expressions of variables in a stage of a side, of the whole robot, and of a sensor; others keep their names.
IN_SIDE = {
    "v": "0.5 * wheel_radius * (psi + other_psi)",
    "w": "side * wheel_radius * (other_psi - psi) / base_width",
    "u": "duty",
    "other_u": "other_duty",
    "s": "k1 * psi",
    "effort": "duty - k1 * psi",
    "load": "load_share",
}
IN_ROBOT = {
    "v": "0.5 * wheel_radius * (psi_left + psi_right)",
    "w": "wheel_radius * (psi_right - psi_left) / base_width",
    "dv": "0.5 * wheel_radius * (domega_left + domega_right)",
    "dw": "wheel_radius * (domega_right - domega_left) / base_width",
    "load": "load_share",
}
IN_SENSOR = {"v": "speed", "w": "yaw_rate", "t": "time"}
# At the middle of a step, from the values at its beginning and end.
SLOW = {
    "theta": f"theta + 0.5 * dt * {IN_ROBOT['w']}",
    "x": "0.5 * (x + x_ahead)",
    "y": "0.5 * (y + y_ahead)",
    "t": "time + 0.5 * dt",
}
REMEMBERED = {
    "charge": Memory("_charge", "s", "charge drawn: load times time", lasting=True),
    "since_turn": Memory("_since_turn", "s", "time since the turn reversed"),
    "way_since_turn": Memory("_way_since_turn", "m", "distance since the turn reversed"),
}
SENSE = Memory("_sense", "-", "which way the robot turned last: 1.0 counter-clockwise")
SIDE_FACTORS = {"both": "", "opposite": "side * ", "left": "(0.5 + 0.5 * side) * ", "right": "(0.5 - 0.5 * side) * "}


class Equations:
    """The statements of a law, by stage, and its memory."""

    def __init__(self, law: Law) -> None:
        self._law = law
        self._lines: dict[str, list[str]] = {}
        self.memory: list[Memory] = []
        self._count = 0
        self._known: dict[tuple[str, str], str] = {}
        stage = law.at.stage
        values = [self._stored(f"{self._expression(formula.root, stage)}", stage) for formula in law.parsed]
        total = " + ".join(f"{name} * {value}" for name, value in zip(law.coefficients, values, strict=True))
        self._line(stage, *_changed(law, total))

    @property
    def by_stage(self) -> dict[str, str]:
        """The statements as the equations of an effect, in the order of the stages."""
        return {stage: "\n".join(self._lines[stage]) for stage in STAGES if stage in self._lines}

    def _line(self, stage: str, *lines: str) -> None:
        self._lines.setdefault(stage, []).extend(lines)

    def _stored(self, expression: str, stage: str, called: str = "") -> str:
        """Assign an expression to a name in a stage, once, and return the name."""
        if (stage, expression) not in self._known:
            if not called:
                self._count += 1
            name = f"_{'each_' if STAGES[stage].per_side else ''}{called or self._count}"
            self._known[stage, expression] = name
            self._line(stage, f"{name} = {expression}")
        return self._known[stage, expression]

    def _expression(self, part: Part, stage: str) -> str:
        """Return a part of a formula as an expression of a stage, after adding the lines that it needs."""
        if part.kind == "number":
            return repr(part.number)
        if part.kind == "name":
            return self._name(part.name, stage)
        if part.kind == "low_pass":
            return self._low_pass(part)
        slow = part.parts and part.names <= {*self._law.constants, *SLOW, *REMEMBERED}
        if slow and not STAGES[stage].of_sensors and stage != BEFORE and not _has_memory(part):
            return self._stored(self._combined(part, BEFORE), BEFORE)
        return self._combined(part, stage)

    def _combined(self, part: Part, stage: str) -> str:
        """Return an operation or a function as an expression."""
        if part.kind == "disc":
            return self._disc(part, stage)
        inner = [self._expression(one, stage) for one in part.parts]
        if part.kind in ("+", "-", "*", "/"):
            return f"({inner[0]} {part.kind} {inner[1]})"
        if part.kind == "**":
            return f"{self._stored(inner[0], stage)} ** {int(part.number)}"
        if part.kind == "negative":
            return f"(-{inner[0]})"
        if part.kind == "sign":
            small = VARIABLES[part.parts[0].name].small
            return f"({inner[0]} / sqrt({inner[0]} * {inner[0]} + {small * small!r}))"
        if part.kind == "tanh":
            return f"(1.0 - 2.0 / (exp(min(2.0 * {inner[0]}, {LARGEST_EXPONENT})) + 1.0))"
        if part.kind == "exp":
            return f"exp(min({inner[0]}, {LARGEST_EXPONENT}))"
        if part.kind == "step":
            return self._step(part, inner, stage)
        if part.kind in ("clip", "dead_zone"):
            value = self._stored(inner[0], stage)
            clipped = f"min(max({value}, -{inner[1]}), {inner[1]})"
            return clipped if part.kind == "clip" else f"({value} - {clipped})"
        return f"{part.kind}({inner[0]})"  # abs, sin, cos

    def _name(self, name: str, stage: str) -> str:
        if name in self._law.constants:
            return self._law.parameter_of(name)
        if STAGES[stage].of_sensors:
            return IN_SENSOR.get(name, name)
        if name in REMEMBERED:
            return self._remembered(name)
        if name in SLOW:
            return self._stored(SLOW[name], BEFORE, name)
        of_side = {**IN_SIDE, **OF_TURNED} if stage == "wheel" else IN_SIDE
        known = of_side if STAGES[stage].per_side else IN_ROBOT
        return self._stored(known[name], stage, name) if name in known else name

    def _step(self, part: Part, inner: list[str], stage: str) -> str:
        if STAGES[stage].of_sensors:
            return f"where({inner[0]} > {inner[1]}, 1.0, 0.0)"
        if part.parts[0].name == "t":
            return f"after({inner[1]})"
        return f"(1.0 if {inner[0]} > {inner[1]} else 0.0)"

    def _disc(self, part: Part, stage: str) -> str:
        x, y, radius = (self._expression(one, stage) for one in part.parts)
        inside = "{radius} - sqrt(({here} - {x}) ** 2 + ({there} - {y}) ** 2)"
        begin = inside.format(radius=radius, here="x", there="y", x=x, y=y)
        if STAGES[stage].of_sensors:
            return f"where({begin} > 0.0, 1.0, 0.0)"
        end = inside.format(radius=radius, here="x_ahead", there="y_ahead", x=x, y=y)
        return f"share({self._stored(begin, BEFORE)}, {self._stored(end, BEFORE)})"

    def _low_pass(self, part: Part) -> str:
        """Return the memory that low-pass filters an expression."""
        inner, seconds = part.parts
        per_side = not inner.names.isdisjoint(OF_A_SIDE)
        stage = "memory" if per_side else "robot_memory"
        now, time = self._stored(self._expression(inner, stage), stage), self._expression(seconds, stage)
        following = f"({now} - FOLLOWED) * (1.0 - exp(-dt / {time}))"
        if (stage, following) not in self._known:
            self._count += 1
            name = f"_behind_{self._count}"
            self._known[stage, following] = name
            self.memory.append(Memory(name, "", "what the law smooths, at the end of the step", per_side=per_side))
            self._line(stage, f"{name} = {name} + {following.replace('FOLLOWED', name)}")
        return self._known[stage, following]

    def _remembered(self, name: str) -> str:
        """Return a memory of the whole robot, after adding the lines that update it."""
        memory = REMEMBERED[name]
        if memory not in self.memory:
            self.memory.append(memory)
            self._line("robot_memory", *self._kept(name, memory.name))
        return memory.name

    def _kept(self, name: str, memory: str) -> Iterator[str]:
        if name == "charge":
            yield f"{memory} = {memory} + load_share * dt"
            return
        turn = self._stored(IN_ROBOT["w"], "robot_memory", "w")
        if SENSE not in self.memory:
            self.memory.append(SENSE)
            yield f"_turned = 1.0 if {turn} > {TURNING} else _sense"
            yield f"_turned = -1.0 if {turn} < -{TURNING} else _turned"
            yield "_same = 1.0 - 0.5 * abs(_turned - _sense)"
            yield "_same = _same if _sense != 0.0 else 0.0"
            yield "_sense = _turned"
        passed = "dt" if name == "since_turn" else f"dt * abs({self._stored(IN_ROBOT['v'], 'robot_memory', 'v')})"
        yield f"{memory} = _same * ({memory} + {passed})"


# In stage `wheel` the speed of a wheel is its mean over the step.
OF_TURNED = {
    "v": "0.5 * wheel_radius * (turned + other_turned) / dt",
    "w": "side * wheel_radius * (other_turned - turned) / (base_width * dt)",
    "psi": "turned / dt",
    "other_psi": "other_turned / dt",
    "s": "k1 * turned / dt",
    "effort": "duty - k1 * turned / dt",
}


def _has_memory(part: Part) -> bool:
    return any(one.kind == "low_pass" for one in part.walk())


def _changed(law: Law, total: str) -> list[str]:
    """Return the statements that add the `total` of a law's formulas at its place."""
    place = law.at
    if place.what == "ahead":
        return [f"_off = {total}", "x = x + _off * cos(theta)", "y = y + _off * sin(theta)"]
    if place.what == "beside":
        return [f"_off = {total}", "x = x - _off * sin(theta)", "y = y + _off * cos(theta)"]
    if place.stage == "pose_time":
        return [f"moment = moment - ({total})"]
    factor = SIDE_FACTORS[law.side] if place.per_side else ""
    by = "dt * " if place.stage == "wheel" else ""
    return [f"{place.what} = {place.what} + {factor}{by}({total})"]
