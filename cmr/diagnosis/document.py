"""Outputs for programs: `diagnosis.json`, and the extended parameter file.

Every field of the document is always there. A number that is not known, or not finite, is null; a list or mapping
without content is empty. `docs/reference/diagnosis_json.md` describes the fields, and a test compares it with them.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cmr.diagnosis.laws import constants_of, law_sentence, values_of
from cmr.diagnosis.result import GENERIC, Against, Candidate, Departure, Diagnosis, Fitted, NamedEffect
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.estimation.laws.result import LawFound
from cmr.estimation.search.trace import Decision, Measure
from cmr.estimation.unexplained.result import GenericTerm, Unexplained
from cmr.files import write_atomically
from cmr.model.catalogue import definition, effects_on
from cmr.model.laws.sentence import equation
from cmr.model.parameters import DEFINITIONS
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.laws import law_content
from cmr.recordings.faults.findings import Finding
from cmr.recordings.lateness import Lateness

SCHEMA = 1
METHOD = "diagnosis"
DIGITS = 6  # decimals of the path errors in a parameter file: micrometres

Document = dict[str, Any]


def document(diagnosis: Diagnosis) -> Document:
    """Return the contents of `diagnosis.json`.

    Raises KeyError for a parameter that the catalogue does not know.
    """
    return {
        "schema": SCHEMA,
        "robot_id": diagnosis.robot_id,
        "verdict": diagnosis.verdict,
        "sentence": diagnosis.sentence,
        "baseline": _fitted(diagnosis.baseline),
        "against": _against(diagnosis.against) if diagnosis.against else None,
        "effects": [_effect(rank, effect) for rank, effect in enumerate(diagnosis.effects, start=1)],
        "extended": _fitted(diagnosis.extended, diagnosis.parameters),
        "gain": _gain(diagnosis.gain),
        "nominal": _fitted(diagnosis.nominal),
        "gain_over_nominal": _gain(diagnosis.gain_over_nominal),
        "laws": _laws(diagnosis),
        "unexplained": _unexplained(diagnosis.unexplained),
        "generic_term": _generic(diagnosis.unexplained.generic),
        "command_lateness": [_lateness(name, one) for name, one in diagnosis.lateness.items()],
        "data_checks": [_data_check(finding) for finding in diagnosis.checks],
        "candidates": [_candidate(candidate) for candidate in diagnosis.candidates],
        "notes": list(diagnosis.notes),
        "next_experiment": diagnosis.next_experiment,
        "not_visible": list(diagnosis.not_visible),
        "sources": list(diagnosis.sources),
        "samples": int(diagnosis.samples),
        "decisions": [_decision(decision) for decision in diagnosis.decisions],
    }


def write_document(diagnosis: Diagnosis, path: Path) -> None:
    """Write `diagnosis.json` atomically.

    Raises OSError when the folder cannot be written.
    """
    text = json.dumps(document(diagnosis), indent=2, allow_nan=False, ensure_ascii=False)
    write_atomically(text + "\n", path)


def extended_file(diagnosis: Diagnosis, provenance: Mapping[str, object]) -> ParameterFile:
    """Return the parameter file of the extended model, `robot_<id>.yaml`; without effects, of the paper's model.

    `provenance` describes the origin of the data; method and path errors are added to it. Raises ParameterFileError for
    an impossible value, KeyError for an unknown parameter.
    """
    estimates = diagnosis.extended.estimates if diagnosis.extended else {}
    effects = effects_on({n: v for n, v in diagnosis.parameters.items() if n not in CONTROLLER_DEFINITIONS})
    in_use = [
        *DEFINITIONS,
        *CONTROLLER_DEFINITIONS,
        *(parameter.name for effect in effects for parameter in effect.all_parameters),
    ]
    values = {
        name: Value(float(diagnosis.parameters[name]), _finite(estimates[name].std) if name in estimates else None)
        for name in in_use
        if name in diagnosis.parameters
    }
    found = {"method": METHOD, "samples": int(diagnosis.samples), **_path_errors(diagnosis.extended)}
    return ParameterFile(
        diagnosis.robot_id, values, tuple(effect.name for effect in effects), provenance={**provenance, **found}
    )


def _path_errors(fitted: Fitted | None) -> dict[str, float]:
    """Return the path errors [m] that are known."""
    if fitted is None:
        return {}
    errors = {"path_rmse_m": fitted.path_rmse, "held_out_path_rmse_m": fitted.held_out_path_rmse}
    return {name: round(float(error), DIGITS) for name, error in errors.items() if math.isfinite(error)}


def _fitted(fitted: Fitted | None, given: Mapping[str, float] | None = None) -> Document:
    """Return a model: its estimates, then given parameters, without standard deviations."""
    estimates = fitted.estimates if fitted else {}
    parameters = {name: _estimate(name, estimate) for name, estimate in estimates.items()}
    for name, value in (given or {}).items():
        parameters.setdefault(name, _estimate(name, Estimate(value, math.nan)))
    return {
        "parameters": parameters,
        "path_rmse_m": _finite(fitted.path_rmse) if fitted else None,
        "held_out_path_rmse_m": _finite(fitted.held_out_path_rmse) if fitted else None,
        "held_out_path_median_m": _finite(fitted.held_out_path_median) if fitted else None,
        "held_out_heading_rmse_rad": _finite(fitted.held_out_heading_rmse) if fitted else None,
        "held_out_heading_median_rad": _finite(fitted.held_out_heading_median) if fitted else None,
    }


def _against(against: Against) -> Document:
    return {
        "file": against.source,
        "sha256": against.sha256,
        "effects": list(against.effects),
        "departures": [_departure(one) for one in against.departures],
    }


def _departure(one: Departure) -> Document:
    return {"name": one.name, "in_file": _finite(one.given), **_with_intervals({one.name: one.estimate})[one.name]}


def _effect(rank: int, effect: NamedEffect) -> Document:
    return {
        "name": effect.name,
        "cause": effect.cause,
        "rank": rank,
        "parameters": _with_intervals(effect.estimates),
        "in_file": _numbers(effect.given),
        "evidence": _evidence(effect),
        "shift": _numbers(effect.shift),
        "indistinguishable_from": list(effect.indistinguishable_from),
        "next_experiment": effect.next_experiment,
    }


def _candidate(candidate: Candidate) -> Document:
    return {
        "name": candidate.name,
        "evidence": _evidence(candidate),
        "why_not": candidate.why_not,
        "parameters": {name: _estimate(name, one) for name, one in candidate.estimates.items()},
        "too_small_to_matter": candidate.harmless,
        "measure": _measure(candidate.measure) if candidate.measure else None,
    }


def _decision(decision: Decision) -> Document:
    return {
        "step": int(decision.step),
        "action": decision.action,
        "effects": list(decision.effects),
        "statistic": _finite(decision.statistic),
        "threshold": _finite(decision.threshold),
        "reason": decision.reason,
        "measures": [_measure(measure) for measure in decision.measures],
    }


def _measure(measure: Measure) -> Document:
    return {
        "quantity": measure.quantity,
        "value": _finite(measure.value),
        "limit": _finite(measure.limit),
        "unit": measure.unit,
    }


def _evidence(tested: NamedEffect | Candidate) -> Document:
    return {
        "statistic": _finite(tested.statistic),
        "p_value": _finite(tested.p_value),
        "held_out": _finite(tested.held_out),
    }


def _gain(gain: Gain | None) -> Document:
    return {
        "held_out_path_rmse_ratio": _finite(gain.ratio) if gain else None,
        "ci95": _interval(gain.interval if gain else (math.nan, math.nan)),
        "signals": _numbers(gain.signals) if gain else {},
    }


def _laws(diagnosis: Diagnosis) -> Document:
    laws = diagnosis.laws
    path_rmse = diagnosis.extended.held_out_path_rmse if diagnosis.extended else math.nan
    return {
        "answer": laws.answer,
        "found": [_law(one, law_sentence(one, path_rmse)) for one in laws.found],
        "indistinguishable_from": [_law(one, law_sentence(one)) for one in laws.rivals],
        "names_withdrawn": list(laws.names_withdrawn),
        "reasons": list(laws.reasons),
        "manoeuvre": laws.manoeuvre or None,
    }


def _law(found: LawFound, sentence: str) -> Document:
    law, units = found.law, found.law.units
    known = {**found.estimates, **{n: Estimate(v, math.nan) for n, v in constants_of(found).items()}}
    parameters = {
        name: {
            "value": _finite(one.value),
            "unit": units[name],
            "std": _finite(one.std),
            "ci95": _interval(one.interval),
        }
        for name, one in known.items()
    }
    return {
        "name": law.name,
        **{"side": "", **law_content(law)},
        "equation": equation(law, values_of(found)),
        "parameters": parameters,
        "held_out_path_rmse_ratio": _finite(found.gain.ratio),
        "ci95": _interval(found.gain.interval),
        "evidence": {
            "score": _finite(found.score),
            "held_out": _finite(found.held_out),
            "left": _finite(found.left),
        },
        "sentence": sentence,
    }


def _unexplained(unexplained: Unexplained) -> Document:
    return {
        "present": bool(unexplained.present),
        "signal": unexplained.signal,
        "regressors": list(unexplained.regressors),
        "share_of_residual_variance": _finite(unexplained.share),
        "not_judged": unexplained.not_judged or None,
    }


def _generic(term: GenericTerm | None) -> Document | None:
    if term is None:
        return None
    return {
        "label": GENERIC,
        "formula": term.formula,
        "parameters": _with_intervals(term.estimates),
        "held_out": _finite(term.held_out),
        "gain": _gain(term.gain),
        "shift": _numbers(term.shift),
    }


def _data_check(finding: Finding) -> Document:
    return {
        "check": finding.check,
        "found": int(finding.found),
        "sentence": finding.sentence if finding.found else None,
    }


def _lateness(name: str, lateness: Lateness) -> Document:
    return {
        "source": name,
        "sentence": lateness.sentence,
        "mean_s": _finite(lateness.mean),
        "std_s": _finite(lateness.std),
        "spread_s": _finite(lateness.spread),
        "changes": lateness.changes,
        "lost_share": lateness.lost if lateness.judged else None,
        "lost_std": lateness.lost_std if lateness.judged else None,
        "judged": lateness.judged,
    }


def _estimate(name: str, estimate: Estimate) -> Document:
    return {"value": _finite(estimate.value), "unit": definition(name).unit, "std": _finite(estimate.std)}


def _with_intervals(estimates: Mapping[str, Estimate]) -> Document:
    return {name: {**_estimate(name, one), "ci95": _interval(one.interval)} for name, one in estimates.items()}


def _interval(interval: tuple[float, float]) -> list[float | None]:
    return [_finite(end) for end in interval]


def _numbers(numbers: Mapping[str, float]) -> dict[str, float | None]:
    return {name: _finite(number) for name, number in numbers.items()}


def _finite(number: float) -> float | None:
    return float(number) if math.isfinite(number) else None
