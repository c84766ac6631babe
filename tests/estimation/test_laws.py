"""Laws: each of the grammar that is looked for leaves the traces that it should, and is found where it is hidden."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cmr.estimation.candidates import Excitation, lanes_of, size
from cmr.estimation.laws.candidates import Candidate, candidates
from cmr.estimation.laws.constants import undetermined
from cmr.estimation.laws.curves import curve_of
from cmr.estimation.laws.further import Further
from cmr.estimation.laws.known import ALIKE, Catalogued, Known, known_beside
from cmr.estimation.laws.linearised import Linearised, is_of_wheels, mixed, seen_in
from cmr.estimation.laws.misfit import misfit_of
from cmr.estimation.laws.naming import law_of
from cmr.estimation.laws.offers import Data, Offer, Refused
from cmr.estimation.laws.refining import FURTHEST, refined, with_best_constants
from cmr.estimation.laws.rest import rest_of
from cmr.estimation.laws.scan import scan
from cmr.estimation.laws.searching import LEAST, SET, narrow, offered
from cmr.estimation.laws.variables import placed, steadied
from cmr.estimation.prediction import SIGNALS, Errors, Predictor
from cmr.estimation.problem import Problem
from cmr.estimation.search.screening import changes_of
from cmr.estimation.segments import segments_of
from cmr.estimation.unexplained.by_formula import structure_of
from cmr.model.catalogue import CATALOGUE
from cmr.model.observer.observer import MOTION, Gains
from cmr.recordings.signal import Floats
from tests.reference_plant import NEUTRAL, packets, recording
from tests.reference_plant.manoeuvres import RICH_DRIVE_SECONDS, rich_drive
from tests.support.lanes import further

pytestmark = pytest.mark.slow

ROBOT = {name: getattr(NEUTRAL, name) for name in ("wheel_radius", "k2_over_k3", "k1", "base_width")}
GAINS = Gains(0.2, 1.0, 0.15, 0.15)
FREE = ("k2_over_k3", "k1", "base_width")
# The standard deviations of errors that are simulated: about those of the plant's sensors.
SIZES = dict(zip(SIGNALS, (0.01, 0.01, 0.01, 0.002, 0.002, 0.004), strict=True))
BY_EFFECT = {
    "quadratic_drag": (Candidate("wheel_acceleration", ("psi", "abs(psi)"), 2, "both"), -1.0),
    "slope_x": (Candidate("wheel_acceleration", ("cos(theta)",), 1, "both"), -1.0),
    "lateral_skid": (Candidate("lateral_speed", ("v", "w"), 2), -1.0),
    "wheel_radius_asymmetry": (Candidate("wheel_slip", ("psi",), 1, "opposite"), 1.0),
    "encoder_scale": (Candidate("encoder_rate", ("psi",), 1, "both"), 1.0),
    "encoder_asymmetry": (Candidate("encoder_rate", ("psi",), 1, "opposite"), 1.0),
    "gyro_bias": (Candidate("gyro", ("1",), 1), 1.0),
    "gyro_scale": (Candidate("gyro", ("w",), 1), 1.0),
    "pose_offset": (Candidate("pose_ahead", ("1",), 1), 1.0),
    "pose_offset_lateral": (Candidate("pose_beside", ("1",), 1), 1.0),
    "pose_latency": (Candidate("pose_lateness", ("1",), 1), 1.0),
}
# Laws that are effects of the catalogue, whatever their size.
EFFECTS = {
    **{name.removesuffix("_x"): law for name, (law, _) in BY_EFFECT.items() if name != "encoder_scale"},
    "coulomb_friction": Candidate("wheel_voltage", ("sign(s)",), 1, "both"),
    "battery_sag": Candidate("wheel_voltage", ("load", "u"), 2, "both"),
    "turn_slip": Candidate("yaw_rate", ("w", "abs(w)"), 2),
    "turn_asymmetry": Candidate("yaw_rate", ("abs(w)",), 1),
    "motor_gain_asymmetry": Candidate("wheel_voltage", ("u",), 1, "opposite"),
    "back_emf_asymmetry": Candidate("wheel_voltage", ("s",), 1, "opposite"),
}
HIDDEN = {
    "speed costs turning": (Candidate("yaw_rate", ("abs(v)", "w"), 2), -0.05),
    "a cubic motor": (Candidate("wheel_voltage", ("u ** 3",), 3, "both"), 0.05),
    "one wheel drags": (Candidate("wheel_voltage", ("s", "abs(s)"), 2, "left"), -0.03),
    "wind": (Candidate("lateral_speed", ("abs(v)", "cos(theta)"), 2, others=(("abs(v)", "sin(theta)"),)), 0.03),
}


@cache
def predictor() -> Predictor:
    """A robot that is exactly the paper's, on a rich drive."""
    (segment,) = segments_of(recording(packets(rich_drive(), RICH_DRIVE_SECONDS), {}, RICH_DRIVE_SECONDS), (), 0)
    return Predictor(segment)


@cache
def model() -> Linearised:
    """That robot, linearised about what it is."""
    excitation = Excitation(ROBOT, turning=1.0, fastest=10.0)
    return Linearised.about(Problem([predictor()], GAINS, excitation), ROBOT, FREE)


def simulated(law: Candidate | None, size: float, seed: int) -> Linearised:
    """The model where its errors are noise, and the traces of a law of this size."""
    random, about = np.random.default_rng(seed), model()
    of: dict[str, Floats] = {
        name: SIZES[name] * random.standard_normal((len(t), 1)) for name, t in predictor().times.items()
    }
    if law is not None:
        (traces,) = about.raw([law])
        coefficients = size * np.array([1.0, 0.5])[: len(law.formulas)]
        of = {name: own + (mixed(law, traces.of[name]) @ coefficients)[:, None] for name, own in of.items()}
    return replace(about, errors=[Errors(of, about.errors[0].motion, about.errors[0].followed)])


def test_every_law_that_is_looked_for_is_one_of_the_grammar_and_there_once() -> None:
    laws = [one.on("both") if is_of_wheels(one.place) else one for one in candidates()]
    written = {(one.place, one.formulas, tuple(one.constants.items())) for one in laws}
    assert len(written) == len(laws)
    for one in laws:
        assert law_of(one).formulas == one.formulas


@pytest.mark.parametrize("effect", list(BY_EFFECT))
def test_a_law_leaves_the_traces_of_the_effect_that_does_the_same(effect: str) -> None:
    law, sign = BY_EFFECT[effect]
    size = 1e-4
    problem = model().problem
    (without,), (beside,) = problem.errors(ROBOT), problem.errors({**ROBOT, effect: size})
    (traces,) = model().raw([law])
    for signal in without.of:
        real = (without.of[signal] - beside.of[signal])[:, 0] / size
        off = sign * mixed(law, traces.of[signal])[:, 0] - real
        assert np.linalg.norm(off) <= 0.1 * np.linalg.norm(real), signal


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_alone_gives_no_law(seed: int) -> None:
    about = simulated(None, 0.0, seed)
    further = Further.beside(about, rest_of(about, about.problem.found(about.errors)))
    assert further.scores[0].score < LEAST
    assert further.inflation() < 1.5


@pytest.mark.parametrize("hidden", [*list(HIDDEN)[:1], *further(*list(HIDDEN)[1:])])
def test_a_hidden_law_comes_first_and_is_fitted_as_it_is(hidden: str) -> None:
    law, size = HIDDEN[hidden]
    about = simulated(law, size, 3)
    rest = rest_of(about, about.problem.found(about.errors))
    best = scan(about, rest)[0].candidate
    assert (best.place, best.side, best.formulas) == (law.place, law.side, law.formulas)
    before, after = refined(about, ()), refined(about, [best])
    assert before is not None
    assert after is not None
    assert after.coefficients[0][0] == pytest.approx(size, rel=0.1)
    assert before.quality() - after.quality() > 100.0
    left = scan(about, after.rest)
    assert left[0].score < LEAST


def test_an_inner_constant_is_found_between_those_that_are_tried() -> None:
    law = Candidate("yaw_rate", ("dead_zone(w, limit)",), 2, constants={"limit": 0.8})
    about = simulated(law, 0.2, 4)
    rest = rest_of(about, about.problem.found(about.errors))
    found = with_best_constants(about, law.with_constants({"limit": 0.6}), rest)
    assert found.constants["limit"] == pytest.approx(0.8, rel=0.1)


@cache
def catalogue_beside() -> tuple[Linearised, Known]:
    """A model that leaves noise alone, and what the catalogue can do beside it."""
    about = simulated(None, 0.0, 5)
    return about, known_beside(about, rest_of(about, about.problem.found(about.errors)), ())


@pytest.mark.parametrize("effect", list(EFFECTS))
def test_a_law_that_the_catalogue_has_is_known(effect: str) -> None:
    about, known = catalogue_beside()
    assert known.same_as(about, EFFECTS[effect]) == effect


@pytest.mark.parametrize("share", [0.1, 0.05])
@pytest.mark.parametrize("effect", list(EFFECTS))
def test_a_small_effect_does_what_its_law_does(effect: str, share: float) -> None:
    """So a search fits the effect, or says that it is too small to matter, and leaves nothing for the law."""
    (about, known), law = catalogue_beside(), EFFECTS[effect]
    rest, problem = known.rest, about.problem
    (switch,) = [one for one in CATALOGUE[effect].parameters if one.switches][:1]
    values = {**about.values, switch.name: share * size(switch, problem.excitation)}
    both = [changes_of(one) for one in problem.errors(lanes_of([about.values, values]))]
    changed = problem.made_white(both, rest.noise)[:, 1]
    rows = rest.rows(seen_in(law.place))
    trace = np.zeros_like(changed)
    trace[rows] = mixed(law, about.white_traces([law], rest.noise, seen_in(law.place)))[:, 0]
    of_effect, of_law = (one - rest.basis @ (rest.basis.T @ one) for one in (changed, trace))
    shared = (of_effect @ of_law) ** 2 / ((of_effect @ of_effect) * (of_law @ of_law))
    assert shared > ALIKE


def test_other_names_of_what_the_catalogue_has_are_known_and_nothing_else() -> None:
    about, known = catalogue_beside()
    # A law of one wheel's voltage in proportion to its duty is unequal motors, once the gain of both is fitted.
    assert known.same_as(about, Candidate("wheel_voltage", ("u",), 1, "left"))
    # A tracked point beside the centre is there slower on the inside of a turn and faster on the outside.
    assert known.same_as(about, Candidate("forward_speed", ("w",), 1)) == "pose_offset_lateral"
    for law, _ in HIDDEN.values():
        assert not known.same_as(about, law)


@pytest.mark.parametrize(
    ("effect", "law"),
    [
        ("pose_offset", Candidate("lateral_speed", ("w",), 1)),  # a point ahead goes sideways as the robot turns
        ("turn_slip", Candidate("yaw_rate", ("w", "abs(w)"), 2)),
        ("gyro_bias", Candidate("gyro", ("1",), 1)),
    ],
)
def test_a_law_that_says_what_an_effect_of_the_model_does_is_known(effect: str, law: Candidate) -> None:
    about = model()
    beside = Linearised.about(about.problem, {**ROBOT, effect: 1e-3}, (*FREE, effect))
    known = Catalogued(beside, rest_of(beside, about.problem.found(about.errors)), (effect,))
    assert known.is_of_model(law)
    assert not any(known.is_of_model(other) for other, _ in HIDDEN.values())


def test_where_wheels_are_as_measured_no_law_speaks_of_motors_or_commands() -> None:
    about = model()
    (rolling,) = (Predictor(one.segment.rolling) for one in about.problem.predictors)
    beside = replace(about, problem=Problem([rolling], GAINS, about.problem.excitation))
    shown = [law for law in candidates() if beside.shows(law)]
    assert all(about.shows(law) for law in candidates())
    assert {law.place for law in shown} == {law.place for law in candidates()} - {"wheel_voltage", "encoder_rate"}
    assert not any(name in formula for law in shown for formula in law.formulas for name in ("effort", "load", "u **"))


def test_speeds_without_the_observer_are_those_by_commands_and_what_encoders_say_beyond() -> None:
    segment, error = predictor().segment, model().errors[0]
    free = error.motion.copy()
    side = MOTION.index("psi_left")
    faster = 0.5 * (free[1:, [side, side + 1]] + free[:-1, [side, side + 1]]) + np.array([0.3, 0.0])
    steady = steadied(free + 1e-9, free, replace(segment, rolled=faster))
    assert steady[:, side] == pytest.approx(free[:, side] + 0.3, abs=1e-6)
    assert steady[:, side + 1] == pytest.approx(free[:, side + 1], abs=1e-6)
    held = free.copy()
    held[:100, side] = 0.0
    assert np.all(steadied(held, free, replace(segment, rolled=faster))[:100, side] == 0.0)


def test_a_place_is_where_the_poses_have_it_and_smoothly() -> None:
    """Where all poses lie 2 cm ahead and 1 cm to the left of the observer's place, so does the robot."""
    error, one = model().errors[0], predictor()
    silent = {name: np.zeros_like(of) for name, of in error.of.items()}
    before = placed(replace(error, of=silent), one)
    for name in ("x", "y"):
        own = error.motion[:, MOTION.index(name)]
        assert before[name] == pytest.approx(0.5 * (own[1:] + own[:-1]), abs=1e-12)

    def moved(forward: Floats, sideways: Floats) -> np.typing.NDArray[np.complex128]:
        after = placed(replace(error, of={**silent, "forward": forward, "sideways": sideways}), one)
        return np.asarray(after["x"] - before["x"] + 1j * (after["y"] - before["y"]))

    ones, nothing = np.ones_like(silent["forward"]), silent["forward"]
    heading = one.segment.observations.pose[:, 2]
    off = moved(0.02 * ones, 0.01 * ones)[np.minimum(one.motion_rows("forward"), one.segment.observations.steps - 1)]
    turning = np.abs(np.gradient(np.unwrap(heading)))
    straight = np.convolve(turning < 1e-3, np.ones(31), "same") > 30.5
    assert np.count_nonzero(straight) > 50
    assert off[straight] == pytest.approx(((0.02 + 0.01j) * np.exp(1j * heading))[straight], abs=1e-4)
    single = nothing.copy()
    single[500] = 0.02
    shift = np.abs(moved(single, nothing))
    assert 0.0 < np.max(shift) < 0.005
    assert np.count_nonzero(shift > 1e-9) < 80  # the steps within 0.2 s on either side


def test_a_spot_on_the_floor_is_found_where_nothing_else_explains_anything() -> None:
    """Of the spot a grid shows a part; the place is then found between its points."""
    spot = {"east": 0.31, "north": 0.42, "radius": 0.33}
    law = Candidate("forward_speed", ("v", "disc(east, north, radius)"), 4, constants=spot)
    about = simulated(law, -0.12, 8)
    further = Further.beside(about, rest_of(about, about.problem.found(about.errors)))
    assert further.scores[0].score < 0.0
    best = further.with_local()[0]
    assert best.score > LEAST
    assert (best.candidate.place, best.candidate.formulas) == (law.place, law.formulas)
    for name, value in spot.items():
        assert best.candidate.constants[name] == pytest.approx(value, abs=0.1)


def test_a_picture_shows_the_law_before_and_nothing_after() -> None:
    law, size = HIDDEN["a cubic motor"]
    about = simulated(law, size, 6)
    fit = refined(about, [law])
    assert fit is not None
    curve = curve_of(fit, 0, law_of(law), None, None)
    assert (curve.variable, curve.unit, curve.place_unit) == ("u", "-", "-")
    course = curve.training
    shown = np.isfinite(course.std) & (course.std < 0.01)
    assert np.count_nonzero(shown) >= 5
    assert np.all(
        np.abs(course.before - course.law)[shown] < 5.0 * course.std[shown] + 0.1 * np.max(np.abs(course.law))
    )
    assert np.all(np.abs(course.after)[shown] < 5.0 * course.std[shown])


def test_nothing_is_claimed_from_one_speed_or_one_radius() -> None:
    (drive,) = model().variables
    assert not narrow(model())
    turning = 0.5 * ROBOT["base_width"] * drive.body["w"]
    one_speed = {**drive.body, "v": np.full_like(drive.body["v"], 0.3)}
    one_radius = {**drive.body, "v": 2.0 * turning}
    for body in (one_speed, one_radius):
        about = replace(model())
        about.__dict__["variables"] = [replace(drive, body=body)]
        assert narrow(about)
        refused = offered(Data.of(about.problem, about, None), about, (), 0.0)
        assert isinstance(refused, Refused)
        assert refused.several


def test_a_constant_is_found_from_far_away() -> None:
    law = Candidate("wheel_slip", ("psi", "step(t, moment)"), 4, "left", constants={"moment": 40.0})
    about = simulated(law, -0.03, 7)
    rest = rest_of(about, about.problem.found(about.errors))
    found = with_best_constants(about, replace(law, constants={"moment": 20.0}, reach={"moment": 8.0}), rest)
    assert found.constants["moment"] == pytest.approx(40.0, abs=0.5)


def test_three_constants_together_come_to_where_nearly_all_is_explained() -> None:
    (drive,) = model().variables
    east, north = (float(np.median(drive.body[name])) for name in ("x", "y"))
    constants = {"east": east, "north": north, "radius": 0.4}
    law = Candidate("forward_speed", ("v", "disc(east, north, radius)"), 4, constants=constants)
    about = simulated(law, -0.3, 8)
    rest = rest_of(about, about.problem.found(about.errors))
    apart = {"east": east + 0.3, "north": north - 0.2, "radius": 0.6}
    reach = {"east": 0.4, "north": 0.4, "radius": 0.15}
    found = with_best_constants(about, replace(law, constants=apart, reach=reach), rest)
    assert scan(about, rest, [found])[0].gain > 0.95 * scan(about, rest, [law])[0].gain  # several discs do so here


def test_constants_that_a_drive_does_not_determine_are_told_from_those_that_it_does() -> None:
    (drive,) = model().variables
    east, north = (float(np.median(drive.body[name])) for name in ("x", "y"))
    constants = {"east": east, "north": north, "radius": 0.4}
    reach = {"east": 0.4, "north": 0.4, "radius": 0.15}
    spot = Candidate("forward_speed", ("v", "disc(east, north, radius)"), 4, constants=constants, reach=reach)
    moment = Candidate("wheel_slip", ("psi", "step(t, moment)"), 4, "left", constants={"moment": 40.0})
    for law, strength, loose in ((spot, -0.02, True), (spot, -0.5, False), (moment, -0.03, False)):
        about = simulated(law, strength, 13)
        rest = rest_of(about, about.problem.found(about.errors))
        fit = refined(about, [with_best_constants(about, law, rest)])
        assert fit is not None
        assert undetermined(fit, SET) is loose


def test_a_constant_goes_no_further_than_it_may() -> None:
    friction = Candidate("wheel_voltage", ("sign(s)",), 1, "both")
    about = simulated(friction, -0.02, 9)
    rest = rest_of(about, about.problem.found(about.errors))
    limited = Candidate("wheel_voltage", ("tanh(s / limit)",), 2, "both", constants={"limit": 0.2})
    found = with_best_constants(about, limited, rest).constants["limit"]
    assert 0.2 / FURTHEST < found < 0.2


def test_a_formula_that_is_not_quite_right_is_told_by_its_own_variable() -> None:
    truth = Candidate("wheel_voltage", ("s", "abs(s)"), 2, "both")
    about = simulated(truth, -0.15, 10)
    right, wrong = refined(about, [truth]), refined(about, [Candidate("wheel_voltage", ("sign(s)",), 1, "both")])
    assert right is not None
    assert wrong is not None
    assert misfit_of(right) < 0.0
    assert misfit_of(wrong) > 0.0


def test_two_terms_of_the_same_variables_at_one_place_are_a_series() -> None:
    square, cube = (Candidate("wheel_voltage", factors, 2, "both") for factors in (("s", "abs(s)"), ("s ** 3",)))
    ahead = Candidate("forward_speed", ("v", "abs(v)"), 2)
    about = simulated(square, -0.15, 11)
    bare = refined(about, ())
    assert bare is not None
    for laws, is_series in (((square, cube), True), ((square, ahead), False), ((square,), False)):
        fit = refined(about, laws)
        assert fit is not None
        offer = Offer(bare, fit, fit, 100.0, 50.0, 50.0, -5.0, further=Further.beside(about, fit.rest), alike=())
        assert offer.series is is_series
        assert offer.approximate is is_series


def test_what_a_refused_formula_explains_is_said_as_structure() -> None:
    law, size = HIDDEN["speed costs turning"]
    fit = refined(simulated(law, size, 12), [law])
    assert fit is not None
    structure = structure_of(fit)
    assert structure.present
    assert set(structure.regressors) == {"speed", "yaw_rate"}
    assert structure.signal in {"yaw_rate", "heading", "sideways"}
    assert 0.0 < structure.share < 1.0
