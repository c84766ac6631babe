"""The text of docs/effects.md, written from the catalogue."""

from collections.abc import Mapping
from textwrap import dedent

from cmr.model.catalogue import CATALOGUE, GENERIC_TERMS, typical
from cmr.model.command_kinds import DUTY, KINDS
from cmr.model.effect import GROUPS, Effect
from cmr.model.parameters import ParameterDefinition
from cmr.model.showcase import LAP, Showcase
from cmr.model.stages import ALWAYS, FUNCTIONS, STAGES, Stage
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS

TYPICAL_K1, TYPICAL_GAIN = 0.054, 118.0  # s/rad, rad/s^2
INTRODUCTION = f"""\
# Effects

What the three-parameter model of the paper leaves out. *Written by `scripts/write_effects_document` from
`cmr/model/effects/`; do not edit.*

An effect is one entry of the catalogue. Simulation, calibration, diagnosis and this page read the same entry, and the
lines printed here as its equation are the code that runs. A parameter that is absent has its neutral value, which
switches the effect off: the robot then moves bit for bit as if the effect did not exist.

Sizes are typical of a robot with wheels of 4 cm radius, K2/K3 = 118 rad/s^2, K1 = 0.054 s/rad, a base width of 0.16 m
and a top speed of 18 rad/s. Pictures show one lap of {LAP:g} s on a figure-eight, driven with the same commands without
the effect (blue, as the paper's model simulates it) and with it (yellow, as the real robot would drive). The dot is the
start. Pictures of sensors show the truth in blue and what the sensor says in yellow. On the right is the signal that
changes, with the effect minus without it, or measured minus true. Where the effect is too small to see, it is drawn
larger, and the caption says by how much.

Duty is the commanded share of full drive, psi the speed of a side's wheels, domega their acceleration. `side` is 1.0 on
the left and -1.0 on the right. The stages of the step, in which the equations stand, are explained
[at the end](#stages-of-the-step).
"""


LAWS_SECTION = """## Laws

A law is a formula at a place in the model, for physics that no entry describes: `cmr-diagnose` proposes laws, and a
file `law_*.yaml` or a parameter file brings them. From then on it is an entry like those above, with equations that
come from its formulas, and only models in which one is used are compiled with it. [The reference](reference/laws.md)
has all that formulas may say, and [a guide](how_to/keep_a_law.md) how to keep one.
"""


def document(showcases: dict[str, Showcase], example: str) -> str:
    """Return the whole page; `example` is the source of an effect of the reader's own."""
    parts = [INTRODUCTION, _contents()]
    for group in GROUPS:
        parts.append(f"## {group.capitalize()}\n")
        parts += [_entry(effect, showcases[effect.name]) for effect in CATALOGUE.values() if effect.group == group]
    return "\n".join([*parts, _velocity_controllers(), LAWS_SECTION, _generic_terms(), _stages(), _own(example)])


def _contents() -> str:
    rows = [
        f"| {group} | {' · '.join(f'[{e.name}](#{e.name})' for e in CATALOGUE.values() if e.group == group)} |"
        for group in GROUPS
    ]
    return "\n".join(["| group | effects |", "|---|---|", *rows, ""])


def _entry(effect: Effect, shown: Showcase) -> str:
    lines = [
        f"### {effect.name}\n",
        f"*{effect.sentence(typical(effect))}*\n",
        f"![{effect.name}](effects/{effect.name}.png)\n",
        f"{caption(shown)}\n",
        "```python",
        _equations(effect),
        "```\n",
        "| parameter | unit | meaning | neutral | typical | from | to |",
        "|---|---|---|---|---|---|---|",
        *(_parameter(parameter) for parameter in effect.all_parameters),
        "",
    ]
    if effect.memory:
        remembered = "; ".join(f"`{memory.name}` [{memory.unit}], {memory.meaning}" for memory in effect.memory)
        lines.append(f"Remembers from step to step: {remembered}.\n")
    lines.append(f"Shows in {effect.shows_in}. Needs {effect.needs}.\n")
    if effect.cause_of_speed:
        said = effect.sentence_of_speed(typical(effect), 1.0 / TYPICAL_K1, TYPICAL_GAIN)
        lines.append(f"Of a robot with a [velocity controller](#velocity-controllers): *{said}*\n")
    if effect.confused_with:
        told_apart = [f"[{other}](#{other}): {manoeuvre}" for other, manoeuvre in effect.confused_with.items()]
        lines.append(f"Confused with, and distinguished by: {'; '.join(told_apart)}.\n")
    return "\n".join(lines)


def _equations(effect: Effect) -> str:
    return "\n\n".join(f"# {_heading(stage)}\n{dedent(code).strip()}" for stage, code in effect.equations.items())


def caption(shown: Showcase) -> str:
    """Return what the picture shows, with the size drawn."""
    sizes = ", ".join(
        f"{parameter.name} = {shown.values[parameter.name]:.4g} {_unit(parameter)}".rstrip()
        for parameter in shown.effect.parameters
    )
    if shown.factor == 1.0:
        return f"Drawn at its typical size: {sizes}."
    is_limit = any(parameter.is_limit for parameter in shown.effect.parameters)
    return f"Drawn {shown.factor:g} times as {'tight' if is_limit else 'strong'} as typical: {sizes}."


def _parameter(parameter: ParameterDefinition) -> str:
    numbers = (parameter.neutral, parameter.typical, parameter.lower, parameter.upper)
    row = (f"`{parameter.name}`", parameter.unit, parameter.meaning, *(f"{number:g}" for number in numbers))
    return f"| {' | '.join(row)} |"


def _unit(parameter: ParameterDefinition) -> str:
    return "" if parameter.unit == "-" else parameter.unit


def _heading(name: str) -> str:
    stage = STAGES[name]
    return f"{name}: {stage.when}{', for each side' if stage.per_side else ''}"


def _velocity_controllers() -> str:
    rows = [
        f"| `{one.name}` | {one.unit} | {one.meaning} | {one.lower:g} | {one.upper:g} |"
        for one in CONTROLLER_DEFINITIONS.values()
    ]
    left_out = ", ".join(
        f"[{effect.name}](#{effect.name})"
        for effect in CATALOGUE.values()
        if set(KINDS) - {DUTY} - {*effect.with_commands}
    )
    return "\n".join(
        [
            "## Velocity controllers\n",
            "Most robots that can be bought take speeds as commands, (v, omega) or wheel speeds, and hold a commanded",
            "speed by themselves. Their parameter files have these in place of `k2_over_k3` and `k1`:\n",
            "| parameter | unit | meaning | from | to |",
            "|---|---|---|---|---|",
            *rows,
            "",
            "```text",
            "wanted_left, wanted_right = (v -+ omega command_base_width / 2) / wheel_radius    within top_wheel_speed",
            "domega = (speed_scale wanted - psi) / response_time",
            "```\n",
            "`speed_scale` is 1 where it is absent, `command_base_width` the robot's `base_width`. That is the",
            "paper's law for the duty wanted / `top_wheel_speed`, and the equations of all effects hold.",
            "[command_delay](#command_delay) is the delay of the response; [electrical_lag](#electrical_lag) makes",
            "it one of second order. [saturation](#saturation), [turn_rate_limit](#turn_rate_limit),",
            "[slew_limit](#slew_limit) and [current_limit](#current_limit) limit speed, turn rate and acceleration;",
            "their duties are shares of `top_wheel_speed`.\n",
            "The controller makes up for what weakens a motor, and follows its own encoders. Effects that are not",
            f"looked for there: {left_out}.",
            "",
        ]
    )


def _generic_terms() -> str:
    rows = [_parameter(parameter) for effect in GENERIC_TERMS.values() for parameter in effect.parameters]
    equations = [_equations(effect) for effect in GENERIC_TERMS.values()]
    return "\n".join(
        [
            "## Generic terms\n",
            "A generic term has no physical cause, and nothing is ever named after it. Where a robot does what no",
            "effect describes, `cmr-diagnose` may give a few of these products a coefficient, if that predicts data",
            "better that it was not fitted on. `u` is a wheel's duty, `s` = K1 psi its share of the no-load speed, v",
            "[m/s] the speed of the body and omega [rad/s] its turn rate. Models without any of them are compiled",
            "without them.\n",
            "```python",
            "\n\n".join(equations),
            "```\n",
            "| parameter | unit | meaning | neutral | typical | from | to |",
            "|---|---|---|---|---|---|---|",
            *rows,
            "",
        ]
    )


def _stages() -> str:
    rows = [f"| `{name}`{' (side)' if stage.per_side else ''} | {_row(stage)} |" for name, stage in STAGES.items()]
    always, functions = (_names(names) for names in (ALWAYS, FUNCTIONS))
    return "\n".join(
        [
            "## Stages of the step\n",
            "The step computes the stages in this order. A stage begins with the paper's value of its variables;",
            "statements change them, in the order of the catalogue. Stages marked (side) are written once and hold for",
            "both sides; the others name the side: `duty_left`. Names that a statement assigns beyond these are the",
            "entry's own, and its later stages read them.\n",
            "| stage | when | begins with, and may change | reads |",
            "|---|---|---|---|",
            *rows,
            "",
            f"Every stage of the motion also reads all parameters and the entry's memory; {always}.",
            f"Functions: {functions}. A choice is written `a if condition else b`; both are computed.",
            "",
        ]
    )


def _row(stage: Stage) -> str:
    return " | ".join([stage.when, _names(stage.changes), _names(stage.reads)])


def _names(names: Mapping[str, str]) -> str:
    return "; ".join(f"`{name}` {meaning}".strip() for name, meaning in names.items())


def _own(example: str) -> str:
    return "\n".join(
        [
            "## An effect of your own\n",
            "Write an entry like this one into a package of yours, say `my_effects.py`:\n",
            f"```python\n{example.strip()}\n```\n",
            "and name it in the package's `pyproject.toml`:\n",
            '```toml\n[project.entry-points."cmr.effects"]\nside_brush = "my_effects:SIDE_BRUSH"\n```\n',
            "Install the package beside CMR. The first step after that composes and compiles the model again, once, in",
            "some 20 s. From then on `side_brush_push` is a parameter like all others: in parameter files, in",
            "`drive` and `Fleet`, in calibration and diagnosis.",
            "",
        ]
    )
