"""A law as an effect of the model: an entry like those of the catalogue."""

from collections.abc import Mapping

from cmr.model.command_kinds import DUTY, KINDS
from cmr.model.effect import LAWS, Effect
from cmr.model.laws.law import LARGEST, Law, positive_constants
from cmr.model.laws.statements import Equations
from cmr.model.parameters import ParameterDefinition

SMALLEST_DIVISOR = 1e-6
USUAL = 0.03  # typical size of a coefficient without an estimate
# The motions that reveal a dependence on a variable, in the words of the catalogue.
NEEDS = {
    "v": "two speeds that differ much",
    "w": "spins at several rates",
    "dv": "big steps",
    "dw": "big steps",
    "psi": "two speeds that differ much",
    "other_psi": "turns both ways",
    "domega": "big steps",
    "other_domega": "steps of one side while the other is held",
    "u": "big steps in both directions",
    "other_u": "steps of one side while the other is held",
    "s": "two speeds that differ much",
    "effort": "starts and reversals",
    "load": "starts and reversals at high duty",
    "theta": "driving in all directions",
    "x": "crossing the place from several sides",
    "y": "crossing the place from several sides",
    "t": "a drive of minutes",
    "charge": "a drive of minutes",
    "since_turn": "turns both ways",
    "way_since_turn": "turns both ways",
}


def law_effect(law: Law, estimates: Mapping[str, float] | None = None) -> Effect:
    """Return a law as an effect, with equations for the stages of the model.

    `estimates` are values of its coefficients by the names of their parameters, which become their typical size.
    """
    equations = Equations(law)
    sizes = estimates or {}
    units = law.units
    coefficients = tuple(
        ParameterDefinition(
            name,
            units[name],
            f"coefficient of {text} in {law.at.words}",
            -LARGEST,
            LARGEST,
            0.0,
            sizes.get(name, USUAL),
            kind=_kind(law, units[name]),
        )
        for name, text in zip(law.coefficients, law.formulas, strict=True)
    )
    return Effect(
        name=law.name,
        group=LAWS,
        cause=_cause(law),
        equations=equations.by_stage,
        parameters=coefficients,
        needs=", ".join(dict.fromkeys(NEEDS[name] for formula in law.parsed for name in formula.variables))
        or "any motion",
        shows_in=law.at.shows_in,
        memory=tuple(equations.memory),
        given=tuple(_given(law, name, units[law.parameter_of(name)]) for name in law.constants),
        with_commands=(DUTY,) if law.place in ("wheel_acceleration", "wheel_voltage") else KINDS,
    )


def _kind(law: Law, unit: str) -> str:
    """Return the kind of a coefficient, by its unit."""
    if unit == "1/m^2":
        return "stretch"
    return "angle" if unit == "rad" and law.at.of_sensors else "size"


def _given(law: Law, constant: str, unit: str) -> ParameterDefinition:
    value = float(law.constants[constant])
    positive = any(constant in positive_constants(formula) for formula in law.parsed)
    lower = SMALLEST_DIVISOR if positive else -LARGEST
    meaning = f"constant {constant} of {' and '.join(law.formulas)}"
    return ParameterDefinition(law.parameter_of(constant), unit, meaning, lower, LARGEST, value, value, switches=False)


def _cause(law: Law) -> str:
    """Return the sentence that describes a law, with a field for each coefficient."""
    units = law.units
    terms = [
        f"{{{name}:+.3g}} {'' if units[name] == '-' else units[name] + ' '}times {_plain(text)}"
        for name, text in zip(law.coefficients, law.formulas, strict=True)
    ]
    whom = {"left": " on the left", "right": " on the right", "opposite": ", with the opposite sign on the right"}
    said = f"{_plain(law.description.rstrip('. '))}: " if law.description.strip() else ""
    what = f"a law changes {law.at.words}{whom.get(law.side, '')} by {' and '.join(terms)}."
    return said + (what if said else what[0].upper() + what[1:])


def _plain(text: str) -> str:
    """Escape braces, so that they are not fields."""
    return text.replace("{", "{{").replace("}", "}}")
