"""The judge, without a closed loop: who is near the best is fitted, and names that do not hold are taken back."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from cmr.investigation.choosing import evidence_of, worth_of
from cmr.investigation.evidence import Beliefs, beliefs_of
from cmr.investigation.exchanging import evidence_beside, revision
from cmr.investigation.judging import NOTHING, Explanation, ahead_since, judge
from cmr.investigation.movements import PERIOD, candidates, opening, waiting
from cmr.investigation.naming import CONFIRMED, NOT_CONFIRMED, TOO_SMALL, Naming
from cmr.parameters.file import ParameterFile, Value
from tests.investigation.investigated import DrivenRobot, without_poses

pytestmark = pytest.mark.slow

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
EXTENT = 1.0  # m
MOVEMENTS = 3  # after the opening
SURE = 13.8  # evidence: odds of 1000 : 1


def beliefs(hidden: Mapping[str, float], *, unseen: bool = False) -> Beliefs:
    """Return what was measured of a robot in which something is hidden, on an opening and a few drawn movements.

    Of one that is `unseen` there are no poses.
    """
    robot = DrivenRobot({**ROBOT, **hidden}, seed=5)
    robot.drive(0.0, 0.0, 0.4)
    for movement in [*opening(), waiting(), *candidates(np.random.default_rng(2), MOVEMENTS)]:
        for left, right in movement.duty:
            robot.drive(float(left), float(right), PERIOD)
    nominal = ParameterFile(0, {name: Value(value) for name, value in ROBOT.items()})
    recording = robot.recording()
    found = beliefs_of(without_poses(recording) if unseen else recording, nominal, EXTENT)
    assert found is not None
    return found


def test_no_explanation_that_was_only_scored_is_near_the_best() -> None:
    """A dead band bends the errors so much that scores of others promise thousands which their fits do not keep."""
    judgement = judge(beliefs({"deadband": 0.1}), (), ROBOT)
    assert judgement.best.name == "deadband"
    assert all(one.fitted for one in judgement.left)


def test_why_the_likeliest_effect_is_not_named_is_said() -> None:
    """At first sight, nothing confirmed it; one that is too small is not named at any odds; nothing needs no reason."""
    naming = Naming()
    judgement = naming.judged(beliefs({"deadband": 0.1}))
    assert (naming.named, naming.held_back) == ((), NOT_CONFIRMED)
    small = replace(judgement.best, values={**judgement.best.values, "deadband": 1e-4})
    naming.judgement = replace(judgement, explanations=(small, *judgement.explanations[1:]))
    assert naming.held_back == TOO_SMALL
    naming.judgement = replace(judgement, explanations=(Explanation(NOTHING, judgement.base.values, 0.0, 0.0), small))
    assert naming.held_back == ""


def test_what_must_be_confirmed_is_driven_for() -> None:
    """A dead band at overwhelming odds: a movement that shows it again would not be worth anything without that."""
    naming = Naming()
    judgement = naming.judged(problem := beliefs({"deadband": 0.1}))
    known = evidence_of(judgement, problem.last)
    (missing,) = naming.unconfirmed.values()
    assert CONFIRMED[0] <= missing <= CONFIRMED[1]
    column = known.columns.of["deadband"][0]
    added = np.zeros((1, *known.information.shape))
    added[0, column, column] = 1e3
    assert worth_of(judgement, known, added, np.ones(1))[0] == 0.0
    assert worth_of(judgement, replace(known, unconfirmed=naming.unconfirmed), added, np.ones(1))[0] > 0.5


def test_a_name_that_another_one_explains_better_is_exchanged_for_it() -> None:
    """A gyro's scale, taken for a skid: the skid leaves, and the scale comes."""
    problem = beliefs({"gyro_scale": 0.03})
    judgement = judge(problem, ("lateral_skid",), {**ROBOT, "lateral_skid": 0.0})
    found = revision(judgement, evidence_beside(judgement))
    assert found is not None
    assert "lateral_skid" not in found.names
    judgement = judge(problem, ("gyro_scale",), {**ROBOT, "gyro_scale": 0.0})
    assert evidence_beside(judgement)["gyro_scale"] > SURE
    assert revision(judgement, evidence_beside(judgement)) is None


def test_what_was_found_holds_on_later_data_alone() -> None:
    """After any moment, the errors support what is there over no effect; at the very end no data are left."""
    judgement = judge(beliefs({"battery_sag": 0.2}), (), ROBOT)
    nothing = judgement.of(NOTHING)
    assert nothing is not None
    assert judgement.best.name == "battery_sag"
    whole, later, none = (ahead_since(judgement, nothing, time) for time in (0.0, 5.0, 1e3))
    assert whole > later > SURE
    assert none == 0.0


def test_what_names_imitate_together_is_not_waited_for() -> None:
    """Unequal motors look like unequal encoders beside wheels that are just as unequal: no drive distinguishes them."""
    hidden = {"wheel_radius_asymmetry": 0.015, "motor_gain_asymmetry": 0.03}
    problem = beliefs(hidden)
    beside = evidence_of(judge(problem, tuple(hidden), {**ROBOT, **hidden}), problem.last)
    alone = evidence_of(judge(problem, (), ROBOT), problem.last)
    assert "encoder_asymmetry" in beside.imitated
    assert not alone.imitated


def test_without_poses_a_scale_of_the_gyro_is_another_base_width() -> None:
    """It is said to be, and not waited for; with poses it shows."""
    unseen, seen = (
        evidence_of(judge(problem, (), ROBOT), problem.last) for problem in (beliefs({}, unseen=True), beliefs({}))
    )
    assert unseen.disguised["gyro_scale"] == "base_width"
    assert "gyro_scale" in unseen.hopeless
    assert not seen.disguised
    assert "gyro_scale" in seen.shown


def test_data_speak_for_an_effect_that_is_there_and_against_others() -> None:
    """A gyro's bias: the odds are for its usual size, and 1000 : 1 against those that the same drive shows."""
    problem = beliefs({"gyro_bias": 0.01})
    known = evidence_of(judge(problem, (), ROBOT), problem.last)
    assert known.contrary["gyro_bias"] < -SURE
    assert known.contrary["encoder_asymmetry"] > SURE
