"""The results of an investigation in words: for a terminal line, and for a page with its story."""

from typing import Any

from cmr.investigation.calibrating import settled
from cmr.investigation.choosing import Evidence
from cmr.investigation.driving import Driving
from cmr.investigation.engine import Decision, Step
from cmr.model.catalogue import CATALOGUE
from cmr.parameters.file import ParameterFile, Value
from cmr.report.likelihood import length, odds
from cmr.report.markup import Html, tag
from cmr.report.page import page_of
from cmr.report.section import paragraph, section
from cmr.report.table import table

NOTHING_MORE = "nothing more"
OUT_OF_REACH = "out of reach here: {needs} would show it, which this floor and {seconds:g} s of driving did not give"
IMITATED = "out of reach here: the named effects imitate it in any drive"
DISGUISED = "out of reach here: to these sensors it looks like another {parameter} in any drive"
REMAINS = "Something remains that no effect explains: errors of {signal} depend on {goes_with}."
SUSPECTED = "{name} is the likeliest further effect ({odds}), but not named: {why}."
MOST_IN_A_LINE = 3  # explanations
BAR = 8  # characters, for certainty


def line(driving: Driving) -> str:
    """Return the newest decision in one line: names, probabilities of explanations, the movement and its reason."""
    story = driving.investigation.story
    if not story:
        return "Opening: a rest, spins both ways, forth and back."
    step = story[-1]
    left = _by_odds(step)[:MOST_IN_A_LINE]
    bars = ", ".join(f"{name or NOTHING_MORE} {_bar(share)} {odds(share)}{_held(step, name)}" for name, share in left)
    named = f"named {', '.join(step.named)}; " if step.named else ""
    return f"{step.time:5.1f} s  {named}{bars}  -> {_chosen(step)}"


def _held(step: Step, name: str) -> str:
    """Return in brackets why the likeliest effect is not named; empty for others."""
    likeliest, _ = _by_odds(step)[0]
    return f" ({step.held_back})" if step.held_back and name == likeliest else ""


def suspicion(decision: Decision | None) -> str:
    """Return the sentence on a likeliest effect that is not named; empty if nothing more is likelier."""
    if decision is None or not decision.held_back:
        return ""
    name, share = max(decision.judgement.probabilities.items(), key=lambda item: item[1])
    return SUSPECTED.format(name=name, odds=odds(share), why=decision.held_back)


def _bar(share: float) -> str:
    """Return a bar as long as on the page of cmr-view."""
    return "#" * max(1, round(BAR * length(share)))


def _chosen(step: Step) -> str:
    if not step.movement:
        return "no further movement"
    first, second = (name or NOTHING_MORE for name in step.parted)
    return f"{step.movement}, {step.seconds:g} s, to separate {first} from {second}"


def document(driving: Driving) -> dict[str, Any]:
    """Return the content of investigation.json: effects named, excluded or out of reach, and the story."""
    investigation = driving.investigation
    return {
        "schema": 1,
        "named": list(investigation.named),
        "too_small_to_matter": [
            name for name in investigation.found if name not in (*investigation.named, *investigation.doubted)
        ],
        "doubted": list(investigation.doubted),
        "excluded": excluded(driving),
        "out_of_reach": out_of_reach(driving),
        "parameters": _parameters(driving),
        "unexplained": _unexplained(driving),
        "driven_seconds": driving.drove,
        "problem": driving.problem,
        "story": [
            {
                "time": step.time,
                "named": list(step.named),
                "probabilities": {name or NOTHING_MORE: share for name, share in step.odds.items()},
                "movement": step.movement,
                "seconds": step.seconds,
                "separates": [name or NOTHING_MORE for name in step.parted],
                "held_back": step.held_back,
            }
            for step in investigation.story
        ],
    }


def calibrated(driving: Driving, robot_id: int) -> ParameterFile:
    """Return the parameter file of a drive: the robot's own parameters averaged, and the effects found as fitted.

    Raises ValueError for a drive without any decision.
    """
    if driving.decision is None:
        raise ValueError("a drive without a decision calibrates nothing")
    judgement = driving.decision.judgement
    values = {name: Value(value) for name, value in judgement.base.values.items()}
    own = settled(judgement, driving.decision.known).estimates
    values |= {name: Value(one.value, std=one.std) for name, one in own.items()}
    provenance = {"method": "investigation", "driven_seconds": driving.drove}
    return ParameterFile(robot_id, values, effects=judgement.named, provenance=provenance)


def sentences(driving: Driving) -> list[str]:
    """Return the findings, sentence by sentence."""
    investigation = driving.investigation
    result = [_cause(name, driving) for name in investigation.named]
    if not result and driving.decision is not None:
        result = ["No effect is named."]
    result += [*filter(None, [suspicion(driving.decision)]), *_remains(driving)]
    gone = excluded(driving)
    if gone:
        result.append(f"Excluded at sizes that matter: {', '.join(gone)}.")
    result += [f"{name}: {why}." for name, why in out_of_reach(driving).items()]
    return [*result, *([driving.problem] if driving.problem else [])]


def _unexplained(driving: Driving) -> dict[str, Any]:
    """Return the remaining structure: the signal whose errors have it, and the variable they depend on."""
    left = driving.investigation.unexplained
    return {"present": left.present, "signal": left.signal, "regressors": list(left.regressors), "share": left.share}


def _remains(driving: Driving) -> list[str]:
    """Return a sentence on the structure that no effect explains; none if nothing remains."""
    left = driving.investigation.unexplained
    if not left.present:
        return []
    signal, goes_with = str(left.signal).replace("_", " "), " and ".join(left.regressors).replace("_", " ")
    return [REMAINS.format(signal=signal, goes_with=goes_with)]


def _cause(name: str, driving: Driving) -> str:
    parameters = _parameters(driving)
    effect = CATALOGUE[name]
    own = {p.name: parameters[p.name]["value"] for p in effect.parameters if p.name in parameters}
    return effect.sentence(own) if len(own) == len(effect.parameters) else f"{name}."


def _parameters(driving: Driving) -> dict[str, dict[str, float]]:
    """Return the fitted parameters, by name, each with its value and standard deviation."""
    if driving.decision is None:
        return {}
    fit = driving.decision.judgement.base
    return {name: {"value": float(fit.values[name]), "std": fit.std(name)} for name in fit.names}


def excluded(driving: Driving) -> list[str]:
    """Return the effects that would have shown and did not; one with a start time may come after the drive."""
    if driving.decision is None:
        return []
    hidden = out_of_reach(driving)
    left = {one.name for one in driving.decision.judgement.left if one.evidence > 0.0}
    names = [name for name in driving.decision.known.columns.names if CATALOGUE[name].locality != "time"]
    return [name for name in names if name not in hidden and name not in left]


def out_of_reach(driving: Driving) -> dict[str, str]:
    """Return why some effects could not be seen, by name."""
    if driving.decision is None:
        return {}
    known = driving.decision.known
    return {name: _why_hidden(name, known, driving.drove) for name in driving.investigation.not_shown(known)}


def _why_hidden(name: str, known: Evidence, seconds: float) -> str:
    if name in known.imitated:
        return IMITATED
    if name in known.disguised:
        return DISGUISED.format(parameter=known.disguised[name])
    return OUT_OF_REACH.format(needs=CATALOGUE[name].needs, seconds=seconds)


def story_page(driving: Driving, robot_id: int, beyond: str = "") -> str:
    """Return a page on what was suspected, what was driven to test it, and how the odds moved.

    `beyond` is the diagnosis of the whole drive, including laws for what no effect explains.
    """
    rows = [
        [
            f"{step.time:.1f}",
            ", ".join(step.named),
            ", ".join(f"{name or NOTHING_MORE} {odds(share)}{_held(step, name)}" for name, share in _by_odds(step)),
            _chosen(step),
        ]
        for step in driving.investigation.story
    ]
    title = f"Investigation of robot {robot_id}"
    told = [*sentences(driving), *([f"The diagnosis of the whole drive: {beyond}"] if beyond else [])]
    found = section("What was found", *(paragraph(sentence) for sentence in told))
    steps = table(("time [s]", "named", "left, with probability", "driven next"), rows, numbers=(0,))
    sizes = [[name, f"{one['value']:.4g}", f"{one['std']:.2g}"] for name, one in _parameters(driving).items()]
    fitted = section("Parameters", table(("parameter", "value", "deviation"), sizes, numbers=(1, 2)))
    return page_of(title, tag("header", tag("h1", title)), Html(""), [found, section("The story", steps), fitted])


def _by_odds(step: Step) -> list[tuple[str, float]]:
    return sorted(step.odds.items(), key=lambda item: -item[1])
