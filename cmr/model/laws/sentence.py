"""Laws in words, and as equations."""

from collections.abc import Iterator, Mapping
from itertools import groupby, product

from cmr.model.laws.grammar import Formula
from cmr.model.laws.law import Law
from cmr.model.laws.tree import Part
from cmr.model.laws.words import VARIABLES

CAUSES = {
    "v": "speed",
    "w": "turning",
    "dv": "acceleration",
    "dw": "turning faster",
    "psi": "wheel speed",
    "other_psi": "the speed of the other wheel",
    "domega": "wheel acceleration",
    "other_domega": "the acceleration of the other wheel",
    "u": "the duty",
    "other_u": "the duty of the other motor",
    "s": "wheel speed",
    "effort": "effort",
    "load": "load",
    "theta": "the heading",
    "x": "the place",
    "y": "the place",
    "t": "time",
    "charge": "the charge drawn",
    "since_turn": "the time since the turn reversed",
    "way_since_turn": "the way since the turn reversed",
}
# Of each place: its name, its symbol, that of the value without the law, and its own variable.
SUBJECTS = {
    "wheel_acceleration": ("wheel acceleration", "domega", "domega_model", "psi"),
    "wheel_voltage": ("motor voltage", "u_motor", "u", "u"),
    "encoder_rate": ("what encoders count", "psi_encoder", "psi", "psi"),
    "wheel_slip": ("rolling", "psi_ground", "psi", "psi"),
    "forward_speed": ("travel", "v", "v_wheels", "v"),
    "lateral_speed": ("motion to the left", "v_left", "", ""),
    "yaw_rate": ("turning", "w", "w_wheels", "w"),
    "gyro": ("the gyro's reading", "w_gyro", "w", "w"),
    "pose_x": ("x of the poses", "x_pose", "x", ""),
    "pose_y": ("y of the poses", "y_pose", "y", ""),
    "pose_theta": ("heading of the poses", "theta_pose", "theta", ""),
    "pose_ahead": ("place of the poses ahead", "ahead_pose", "", ""),
    "pose_beside": ("place of the poses to the left", "left_pose", "", ""),
    "pose_lateness": ("age of the poses", "age_pose", "", ""),
}
OF_THEMSELVES = ("w_wheels", "v_wheels", "w", "psi", "u")  # a law may be a share of these values
TIGHTNESS = {"+": 1, "-": 1, "negative": 3, "*": 3, "/": 3, "**": 4}


def headline(law: Law, values: Mapping[str, float]) -> str:
    """Return a short description of a law, such as "Speed costs turning"."""
    what, _, _, own = SUBJECTS[law.place]
    named = dict.fromkeys(name for formula in law.parsed for name in formula.variables)
    causes = list(dict.fromkeys(CAUSES[name] for name in named if name != own))
    if not named:
        return f"{_capital(what)} has an offset"
    if not causes:
        return f"{_capital(what)} depends on {CAUSES[own]} in another way than the model says"
    said = _listed(causes)
    if own in named and len(law.formulas) == 1:
        sense = _sense(law.parsed[0], own, law.constants)
        if sense:
            gains = sense * values[law.coefficients[0]] > 0.0
            return (
                f"{_capital(said)} {'add' if len(causes) > 1 else 'adds'} to {what}"
                if gains
                else (f"{_capital(said)} {'cost' if len(causes) > 1 else 'costs'} {what}")
            )
    return f"{_capital(what)} depends on {said}"


def equation(law: Law, values: Mapping[str, float]) -> str:
    """Return a law with these values of its parameters, such as "w = w_wheels (1 - 0.061 s/m abs(v))"."""
    _, symbol, without, own = SUBJECTS[law.place]
    terms = list(zip(law.coefficients, law.parsed, strict=True))
    constants = {name: f"{values.get(law.parameter_of(name), value):.3g}" for name, value in law.constants.items()}
    split = [_without_factor(formula.root, own) for formula in law.parsed]
    units = law.units
    side = {"left": " on the left", "right": " on the right", "opposite": ", opposite on the right"}.get(law.side, "")
    if without in OF_THEMSELVES and all(rest is not None for rest in split):
        factors = "".join(
            _term(values[name], units[name], _product(rest or [], constants))
            for (name, _), rest in zip(terms, split, strict=True)
        )
        return f"{symbol} = {without} (1{factors}){side}"
    added = "".join(_term(values[name], units[name], written(one.root, constants)) for name, one in terms)
    return f"{symbol} = {without}{added}{side}" if without else f"{symbol} = {added.removeprefix(' + ').strip()}{side}"


def written(part: Part, constants: Mapping[str, str], within: int = 0) -> str:
    """Format a part of a formula: products without a sign, with the values of constants."""
    tight = TIGHTNESS.get(part.kind, 9)
    if part.kind == "number":
        return f"{part.number:g}"
    if part.kind == "name":
        return constants.get(part.name, part.name)
    if part.kind == "*":
        text = _product(list(_factors(part)), constants)
    elif part.kind in ("+", "-", "/"):
        sign = "/" if part.kind == "/" else f" {part.kind} "
        one, other = part.parts
        text = written(one, constants, tight) + sign + written(other, constants, tight + (part.kind != "+"))
    elif part.kind == "negative":
        text = f"-{written(part.parts[0], constants, tight)}"
    elif part.kind == "**":
        text = f"{written(part.parts[0], constants, tight + 1)}^{int(part.number)}"
    else:
        text = f"{part.kind}({', '.join(written(one, constants) for one in part.parts)})"
    return f"({text})" if tight < within else text


def _term(value: float, unit: str, text: str) -> str:
    """Return a term of a sum, with its sign."""
    sign = "-" if value < 0.0 else "+"
    words = [f"{abs(value):.3g}", *([] if unit == "-" else [unit]), *([] if text == "1" else [text])]
    return f" {sign} {' '.join(words)}"


def _product(factors: list[Part], constants: Mapping[str, str]) -> str:
    tight = TIGHTNESS["*"]
    texts = [written(one, constants, tight + (one.kind == "negative" and k > 0)) for k, one in enumerate(factors)]
    powers = [(text, len(list(same))) for text, same in groupby(texts)]
    return " ".join(text if count == 1 else f"{text}^{count}" for text, count in powers) or "1"


def _factors(part: Part) -> Iterator[Part]:
    """Yield the factors of a product, or the part itself."""
    if part.kind == "*":
        for one in part.parts:
            yield from _factors(one)
    else:
        yield part


def _without_factor(part: Part, name: str) -> list[Part] | None:
    """Return the factors of a product without the first one that is this variable; None if there is none."""
    factors = list(_factors(part))
    for number, one in enumerate(factors):
        if one.kind == "name" and one.name == name:
            return factors[:number] + factors[number + 1 :]
    return None


def _sense(formula: Formula, own: str, constants: Mapping[str, float]) -> int:
    """Return 1 or -1 if a formula always has the sign of one variable, or the opposite; otherwise 0."""
    if any(part.kind == "low_pass" for part in formula.root.walk()):
        return 0
    others = [name for name in formula.variables if name != own]
    signs = set()
    for values in product(*((-1.0, -0.3, 0.3, 1.0) if VARIABLES[n].unit != "s" else (0.3, 1.0) for n in others)):
        for mine in (-0.7, 0.7):
            found = float(formula.evaluate({**constants, **dict(zip(others, values, strict=True)), own: mine}))
            signs.add(0 if found == 0.0 else 1 if found * mine > 0.0 else -1)
    return signs.pop() if len(signs) == 1 else 0


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
