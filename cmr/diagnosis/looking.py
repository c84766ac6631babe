"""Search by moments; where that cannot be trusted, or there are no commands, search by courses instead."""

from collections.abc import Callable

from cmr.diagnosis.courses import CourseStudy
from cmr.diagnosis.engine import Ready
from cmr.diagnosis.gains import COARSE
from cmr.diagnosis.naming import Search, search
from cmr.model.parameters import DEFINITIONS as PAPER

TRUSTED = 4.0  # inflation up to which errors of moments are what they are taken for
ASTRAY = 2.5  # factor by which the paper's parameters may differ from those of free runs


def look(ready: Ready, say: Callable[[str], None]) -> Search:
    """Return what the search found in recordings that were not refused."""
    assert ready.study is not None
    assert ready.base is not None
    if not ready.rolling:
        found = search(ready.study, ready.base, say)
        if trusted(found, ready):
            return found
        say("No model foretells this robot from moment to moment: looking at the course of its motion instead ...")
    courses = CourseStudy(ready.study.predictors, ready.study.gains, ready.study.scene)
    return search(courses, courses.base(ready.start, ready.base.names), say)


def trusted(found: Search, ready: Ready) -> bool:
    """Tell whether errors of moments behaved as chance does, and led to a model that free runs allow.

    Those of coarse encoders never do, and are allowed for.
    """
    final = found.final
    factors = [final.values[name] / ready.start[name] for name in final.names if name in PAPER]
    coarse = max(predictor.piece.tick for predictor in found.study.predictors) > COARSE
    return (coarse or found.inflation <= TRUSTED) and all(1.0 / ASTRAY < factor < ASTRAY for factor in factors)
