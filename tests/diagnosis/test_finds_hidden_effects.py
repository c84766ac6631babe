"""Effects hidden in logs of an independent plant are found: the sample that CI runs of scripts/study_diagnosis.

Its seeds are none of the study's. Alone: pytest -m hidden_effects. The logs are diagnosed in as many processes as
there are cores while the tests wait for theirs; where pytest-xdist runs the tests, one after another in its process.
"""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache

import pytest
from _pytest.mark.structures import ParameterSet

from tests.hidden_effects import judging
from tests.hidden_effects.cases import BEGINNING, EIGHT, EIGHT_OPEN, RICH, Case
from tests.hidden_effects.diagnosing import diagnosed
from tests.hidden_effects.rows import Row
from tests.support.lanes import further

pytestmark = [pytest.mark.hidden_effects, pytest.mark.slow]

Cases = Sequence[Case | ParameterSet]

SEED = 1000  # the problem's seeds are smaller
# Some of each group of the catalogue; scripts/study_diagnosis hides them all.
EFFECTS = ("backlash",)  # dry friction: test_work.py; late commands: test_command_timing.py
MORE_EFFECTS = (
    "battery_sag",
    "surface_patch",
    "pose_smoothing",
    "deadband",
    "payload_change",
    "turn_slip",
    "pose_heading_offset",
)
SINGLE = [Case((effect,), BEGINNING, SEED) for effect in EFFECTS]
MORE = [Case((effect,), BEGINNING, SEED) for effect in MORE_EFFECTS]
ON_RICH_DRIVES = [Case((effect,), RICH, SEED) for effect in ("coulomb_friction", *EFFECTS, *MORE_EFFECTS)]
# Some that a figure-eight shows, some that it hides, and some that it cannot tell from others.
EIGHTS: Cases = [
    Case(("wheel_radius_asymmetry",), EIGHT, SEED),
    *further(*(Case((effect,), EIGHT, SEED) for effect in ("deadband", "gyro_bias", "command_delay"))),
]
LOUD = "threefold_slow"
NULLS: Cases = [
    Case((), BEGINNING, SEED),  # on the whole rich drive: a further test of test_work.py
    *further(*(Case((), EIGHT, SEED + 1, LOUD), Case((), RICH, SEED), Case((), EIGHT, SEED))),
    *further(Case((), RICH, SEED + 1, LOUD), Case((), "ramps", SEED)),
]
COARSE: Cases = [
    Case((), BEGINNING, SEED, "coarse"),
    *further(*(Case((), manoeuvre, SEED, "coarse") for manoeuvre in (RICH, EIGHT_OPEN))),
]
# Two others: test_shifts.py and test_late_wheels.py
PAIRS: Cases = further(Case(("command_delay", "wheel_radius_asymmetry"), RICH, SEED))
# weak_reverse and cubic_motor: test_generic.py; others: test_finds_hidden_laws.py
UNKNOWN_PHYSICS: Cases = further(
    Case(("torque_ripple",), BEGINNING, SEED),
    *(Case((kind,), RICH, SEED) for kind in ("torque_ripple", "gyro_magnetism")),
)

Rows = Callable[[Case], Row]


def named(case: Case) -> str:
    """What a test of this case is called."""
    return "-".join([*case.effects, case.manoeuvre, case.noise, str(case.seed)])


def of(cases: Cases) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("case", cases, ids=named)


def sound(row: Row) -> Row:
    assert not row.error, row.error
    return row


@pytest.fixture(scope="module")
def row_of(request: pytest.FixtureRequest) -> Iterator[Rows]:
    """Diagnose the logs of the tests that will be run."""
    if "PYTEST_XDIST_WORKER" in os.environ:  # processes of their own would have no cores, and load everything again
        yield cache(lambda case: sound(diagnosed("sample", case)))
        return
    using = [item for item in request.session.items if "row_of" in getattr(item, "fixturenames", ())]
    asked = [case for item in using for case in cases_of(item)]
    threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    with pytest.MonkeyPatch.context() as patch:
        for name, count in threads.items():
            patch.setenv(name, count)
        with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn")) as pool:
            futures = {case: pool.submit(diagnosed, "sample", case) for case in dict.fromkeys(asked)}
            yield lambda case: sound(futures[case].result())
            pool.shutdown(cancel_futures=True)


def cases_of(item: pytest.Item) -> list[Case]:
    """The cases that a test waits for: its own, or all with a single effect."""
    parameters = getattr(item, "callspec", None)
    return SINGLE if parameters is None else [parameters.params["case"]]


def whole_story(row: Row) -> str:
    """What to read when a test fails."""
    remains = f"; unexplained in {row.unexplained_signal}" if row.unexplained else ""
    named = f"{row.names} beside {row.indistinguishable}, {row.estimates}"
    return f"hidden {dict(row.parameters)}; {row.verdict}: {named}{remains}"


@of([*SINGLE, *further(*MORE, *ON_RICH_DRIVES)])
def test_a_hidden_effect_is_named_first_and_nothing_wrong_beside_it(row_of: Rows, case: Case) -> None:
    row = row_of(case)
    assert judging.right_first(row), whole_story(row)
    assert not judging.wrongly_named(row), whole_story(row)


def test_nine_of_ten_parameters_of_what_is_named_are_within_five_percent_or_three_deviations(row_of: Rows) -> None:
    # The problem asks for 95 %; a sample of this size is that far off by chance.
    right = [row for row in map(row_of, SINGLE) if judging.right_first(row)]
    wrong = [whole_story(row) for row in right if not judging.parameters_right(row)]
    assert len(wrong) <= 0.1 * len(right), "\n".join(wrong)


@of(EIGHTS)
def test_on_eights_alone_what_is_named_holds_the_truth_and_silence_says_what_to_drive(row_of: Rows, case: Case) -> None:
    row = row_of(case)
    if row.names:
        assert judging.may_be(row, 0, case.effects[0]), whole_story(row)
        assert not judging.wrongly_named(row), whole_story(row)
    else:
        assert row.verdict == "no_effect", whole_story(row)
        assert row.next_experiment


@of(NULLS)
def test_nothing_is_named_or_called_unexplained_where_nothing_is_hidden(row_of: Rows, case: Case) -> None:
    row = row_of(case)
    assert judging.silent(row), whole_story(row)


@of(COARSE)
def test_a_coarse_encoder_is_never_taken_for_anything_else(row_of: Rows, case: Case) -> None:
    row = row_of(case)
    assert set(row.names) <= {"encoder_quantisation"}, whole_story(row)


@of(PAIRS)
def test_of_two_hidden_effects_both_are_named_and_nothing_else(row_of: Rows, case: Case) -> None:
    row = row_of(case)
    assert judging.all_named(row), whole_story(row)
    assert len(row.names) == 2, whole_story(row)


@of(UNKNOWN_PHYSICS)
def test_physics_that_no_effect_describes_raises_the_alarm(row_of: Rows, case: Case) -> None:
    row = row_of(case)
    if row.verdict == "law_found":
        assert not row.names, whole_story(row)
    else:
        assert judging.flagged(row), whole_story(row)
        assert "record the same drive again" in row.next_experiment
