"""Find out what the paper's model gets wrong about a robot, and why."""

from collections.abc import Callable, Sequence

from cmr.calibration.result import CalibrationError, Estimate
from cmr.diagnosis.engine import Ready, prepare
from cmr.diagnosis.naming import Named, Search, needed, search
from cmr.diagnosis.next_experiment import experiment_to_show, experiment_to_tell_apart
from cmr.diagnosis.result import (
    BAD_DATA,
    EFFECTS_FOUND,
    NO_EFFECT,
    Candidate,
    Diagnosis,
    Fitted,
    NamedEffect,
)
from cmr.diagnosis.study import Fit
from cmr.model.catalogue import CATALOGUE, DEFINITIONS, definition
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording


def diagnose(
    recordings: Recording | Sequence[Recording],
    nominal: ParameterFile | None = None,
    *,
    held_out: Sequence[Recording] = (),
    sources: Sequence[str] = (),
    progress: Callable[[str], None] = lambda sentence: None,
) -> Diagnosis:
    """Diagnose one robot from one or more of its recordings.

    `nominal` gives at least wheel_radius; by default it is what the first recording announces. On `held_out` the gain
    is measured, and nothing is fitted. `progress` is told, in a sentence, what is being done.
    Raises CalibrationError when the paper's model cannot be fitted for a reason other than bad data.
    """
    recordings = [recordings] if isinstance(recordings, Recording) else list(recordings)
    nominal = nominal or next((r.parameters for r in recordings if r.parameters is not None), None)
    if nominal is None or not nominal.has("wheel_radius"):
        raise CalibrationError(
            "The wheel radius is not known: the log announces no parameters. Give a file with at least wheel_radius "
            "by --parameters."
        )
    progress("Checking the data ...")
    ready = prepare(recordings, nominal)
    if ready.refused:
        return Diagnosis(
            robot_id=recordings[0].robot_id,
            verdict=BAD_DATA,
            sentence=ready.refused,
            checks=ready.checks,
            notes=ready.notes,
            sources=tuple(sources),
        )
    found = search(ready.study, ready.base, progress)
    return _diagnosis(recordings[0].robot_id, ready, found, tuple(sources))


def _diagnosis(robot_id: int, ready: Ready, found: Search, sources: tuple[str, ...]) -> Diagnosis:
    effects = tuple(_named(one, found) for one in found.named)
    verdict = EFFECTS_FOUND if effects else NO_EFFECT
    return Diagnosis(
        robot_id=robot_id,
        verdict=verdict,
        sentence=_sentence(effects),
        baseline=Fitted(
            estimates=_estimates(found.base, found), path_rmse=float("nan"), held_out_path_rmse=float("nan")
        ),
        extended=Fitted(
            estimates=_estimates(found.final, found), path_rmse=float("nan"), held_out_path_rmse=float("nan")
        ),
        effects=effects,
        candidates=tuple(
            Candidate(
                name=tried.effect.name,
                statistic=tried.drop,
                p_value=p_value(tried.drop, len(tried.effect.parameters), found.inflation),
                held_out=tried.held_out,
                why_not=why,
            )
            for tried, why in found.others
        ),
        checks=ready.checks,
        notes=ready.notes,
        next_experiment=None if effects else experiment_to_show(()),
        parameters=_parameters(found),
        sources=sources,
        samples=len(found.final.rest),
    )


def _named(one: Named, found: Search) -> NamedEffect:
    effect = one.tried.effect
    names = [parameter.name for parameter in effect.parameters]
    rivals = one.rivals
    estimates = {
        n: one.estimates[n] if n in one.estimates else _estimate(found.final, n, found.inflation) for n in names
    }
    return NamedEffect(
        name=effect.name,
        cause=effect.sentence({name: estimate.value for name, estimate in estimates.items()}),
        estimates=estimates,
        statistic=one.tried.drop,
        p_value=p_value(one.tried.drop, len(names), found.inflation),
        held_out=one.tried.held_out,
        shift={n: found.final.values[n] - one.before.values[n] for n in found.base.names},
        indistinguishable_from=rivals,
        next_experiment=experiment_to_tell_apart(effect.name, rivals) if rivals else None,
    )


def _parameters(found: Search) -> dict[str, float]:
    """Return all values that the extended model runs with."""
    values = dict(found.final.values)
    for one in found.named:
        values.update({name: estimate.value for name, estimate in one.estimates.items()})
    return {name: value for name, value in values.items() if name in PAPER or value != definition(name).neutral}


def _estimates(fit: Fit, found: Search) -> dict[str, Estimate]:
    return {name: _estimate(fit, name, found.inflation) for name in fit.names}


def _estimate(fit: Fit, name: str, inflation: float) -> Estimate:
    return Estimate(fit.values[name], fit.std(name) * float(inflation) ** 0.5)


def p_value(drop: float, parameters: int, inflation: float) -> float:
    """Return how often chance alone gives as large a drop somewhere in the catalogue."""
    from scipy.stats import chi2

    return float(min(1.0, len(DEFINITIONS) * chi2.sf(drop / inflation, parameters)))


def _sentence(effects: Sequence[NamedEffect]) -> str:
    if not effects:
        return f"Nothing in the data speaks for any of the {len(CATALOGUE)} effects: the paper's model is enough."
    return " ".join(effect.cause for effect in effects)
