"""Laws in files: what is written is read again, and what a hostile file says is an error and nothing else."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from cmr.model.catalogue import CATALOGUE, DEFINITIONS, LAWS, MOST_LAWS, learn, unlearn
from cmr.model.laws import Law
from cmr.model.laws.law import LawError
from cmr.model.laws.places import PLACES
from cmr.parameters.file import ParameterFile, ParameterFileError, Value, parse
from cmr.parameters.laws import (
    Coefficient,
    LawFile,
    LawFileError,
    laws_beside,
    parse_law,
    read_law,
    write_law,
)

TURN_COST = Law("law_turn_cost", "yaw_rate", ("w * abs(v)",), description="Speed: costs # turning")
BUZZ = Law("law_buzz", "wheel_voltage", ("sin(freq * t)", "cos(freq * t)"), "left", {"freq": 12.5})
PAPER = {"wheel_radius": 0.04, "k2_over_k3": 60.0, "k1": 0.04, "base_width": 0.2}


@pytest.fixture(autouse=True)
def _catalogue_as_before() -> Iterator[None]:
    known = set(LAWS)
    yield
    for name in set(LAWS) - known:
        unlearn(name)


def robot_with(law: Law, **values: float) -> ParameterFile:
    """Return the parameters of a robot with a law, which is learned."""
    learn(law)
    return ParameterFile(0, {name: Value(value) for name, value in {**PAPER, **values}.items()}, (law.name,))


def test_a_law_is_kept_shared_and_read_again(tmp_path: Path) -> None:
    kept = LawFile(TURN_COST, {"law_turn_cost": Coefficient(-0.061, 0.002)}, ("robot_0.yaml", "day 2: robot_1.yaml"))

    write_law(tmp_path / "law_turn_cost.yaml", kept)

    assert read_law(tmp_path / "law_turn_cost.yaml") == kept
    assert laws_beside(tmp_path / "robot_0.yaml") == [tmp_path / "law_turn_cost.yaml"]
    assert "law_turn_cost" not in LAWS  # reading is not learning


def test_whoever_receives_parameters_can_run_their_laws() -> None:
    text = robot_with(BUZZ, law_buzz_1=0.02, law_buzz_2=-0.01, law_buzz_freq=11.0).to_yaml()
    unlearn("law_buzz")  # another process

    received = parse(text)

    assert received.effects == ("law_buzz",)
    assert LAWS["law_buzz"].formulas == BUZZ.formulas
    assert received.robot_parameters.effects == {"law_buzz_1": 0.02, "law_buzz_2": -0.01, "law_buzz_freq": 11.0}
    assert parse(received.to_yaml()).values == received.values


def test_the_constants_of_a_robot_are_its_own() -> None:
    learn(BUZZ)  # as another robot has it
    content = yaml.safe_load(robot_with(BUZZ, law_buzz_1=0.02).to_yaml())
    content["laws"]["law_buzz"]["constants"]["freq"] = 3.0

    received = parse(yaml.safe_dump(content))

    assert received.value("law_buzz_freq") == 3.0
    assert received.laws[0].constants == {"freq": 3.0}


def test_a_file_without_laws_is_written_as_before() -> None:
    assert "laws" not in ParameterFile(0, {name: Value(value) for name, value in PAPER.items()}).to_yaml()


def test_a_wrong_file_leaves_no_law_behind() -> None:
    text = robot_with(TURN_COST, law_turn_cost=-0.061).to_yaml()
    unlearn("law_turn_cost")

    for wrong in (
        text.replace("robot_id: 0", "robot_id: -7"),
        text.replace("w * abs(v)", "w * open(v)"),
        text.replace("unit: s/m", "unit: m"),
        text.replace("yaw_rate", "moon"),
    ):
        with pytest.raises(ParameterFileError):
            parse(wrong)
        assert "law_turn_cost" not in {*LAWS, *CATALOGUE, *DEFINITIONS}


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("w * abs(v)", "w * (abs(v)", r"laws: law_turn_cost: formulas: .*expected '\)'"),
        ("place: yaw_rate", "place: moon", "laws: law_turn_cost: place: must be one of"),
        ("formulas: [w * abs(v)]", "formulas: w * abs(v)", "must be a list of formulas"),
        ("place: yaw_rate", "stage: body", "unknown key 'stage'"),
        ("  law_turn_cost: {place", "  turn_cost: {place", "must be law_ and words"),
    ],
)
def test_a_wrong_law_says_where(old: str, new: str, says: str) -> None:
    text = robot_with(TURN_COST, law_turn_cost=-0.061).to_yaml()
    unlearn("law_turn_cost")

    with pytest.raises(ParameterFileError, match=says) as error:
        parse(text.replace(old, new))
    assert "line " in str(error.value)


def test_a_name_is_one_law_for_all_robots() -> None:
    text = robot_with(TURN_COST, law_turn_cost=-0.061).to_yaml()

    with pytest.raises(ParameterFileError, match="the name of another law, w \\* abs\\(v\\)"):
        parse(text.replace("w * abs(v)", "w * abs(v) * abs(w)").replace("unit: s/m", "unit: s^2/m"))


def test_a_process_learns_no_more_laws_than_it_says() -> None:
    for number in range(MOST_LAWS - len(LAWS)):
        learn(Law(f"law_{number}", "gyro", ("w",)))
    with pytest.raises(LawError, match="as many as it learns"):
        learn(TURN_COST)
    many = {f"law_a{number}": {"place": "gyro", "formulas": ["w"]} for number in range(9)}
    with pytest.raises(ParameterFileError, match="at most 8 laws"):
        parse(yaml.safe_dump({"schema": 1, "robot_id": 0, "parameters": {}, "laws": many}))


WORDS = st.sampled_from(
    [
        *("schema", "law", "laws", "place", "side", "formulas", "constants", "description", "coefficients", "sources"),
        *("value", "std", "unit", "law_a", "law_turn_cost", "w * abs(v)", "w", "both", "left", "tau", "__class__"),
        *("exp(t / tau)", "disc(tau, 1, 2)", "{", "!!python/object/apply:os.system [true]", "", "law_a__b"),
        *PLACES,
    ]
)
ANYTHING = st.recursive(
    st.one_of(WORDS, st.integers(), st.floats(), st.booleans(), st.none(), st.text(max_size=20), st.binary(max_size=8)),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(WORDS, inner, max_size=4)),
    max_leaves=12,
)
WHOLE = st.fixed_dictionaries(
    {},
    optional={
        "schema": st.just(1) | ANYTHING,
        "law": st.just("law_a") | ANYTHING,
        "place": st.sampled_from([*PLACES]) | ANYTHING,
        "side": st.sampled_from(["", "both"]) | ANYTHING,
        "formulas": st.lists(st.sampled_from(["w", "v*w", "exp(-t/tau)", "1", "psi"]), max_size=4) | ANYTHING,
        "constants": st.dictionaries(st.sampled_from(["tau", "v"]), st.floats() | st.integers()) | ANYTHING,
        "description": ANYTHING,
        "coefficients": ANYTHING,
        "sources": ANYTHING,
    },
)


@given(WHOLE | ANYTHING)
def test_any_content_is_a_law_or_an_error_of_law_files(content: object) -> None:
    try:
        text = yaml.safe_dump(content)
    except yaml.YAMLError:
        return
    try:
        found = parse_law(text)
    except LawFileError:
        return
    assert parse_law(found.to_yaml()) == found


@given(st.text(max_size=300))
def test_any_text_is_a_law_or_an_error_of_law_files(text: str) -> None:
    try:
        parse_law(text)
    except LawFileError:
        return
    assert "law_" in text


@given(st.dictionaries(WORDS, WHOLE | ANYTHING, max_size=3) | ANYTHING)
def test_any_laws_in_a_parameter_file_are_laws_or_an_error_of_parameter_files(laws: object) -> None:
    before = set(LAWS)
    content = {"schema": 1, "robot_id": 0, "parameters": {name: {"value": value} for name, value in PAPER.items()}}
    try:
        text = yaml.safe_dump({**content, "laws": laws})
        parse(text)
    except (ParameterFileError, yaml.YAMLError):
        assert set(LAWS) == before
    for name in set(LAWS) - before:
        unlearn(name)


@pytest.mark.parametrize(
    "text",
    [
        "!!python/object/apply:os.system [echo hello]",
        "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]",
        "[" * 10_000,
        "schema: 1\nlaw: law_a\nplace: yaw_rate\nformulas: ['" + "(" * 299 + "']",
        "schema: 1\nlaw: law_a\nplace: yaw_rate\nformulas: [" + ", ".join(["w"] * 4000) + "]",
        "schema: 1\nlaw: law_a\nplace: yaw_rate\nformulas: [w]\nconstants: {a: " + "9" * 400 + "}",
        "schema: 1\nschema: 1",
        "\0",
        "schema: 1\nlaw: law_a\nplace: yaw_rate\nformulas: ['exec(v)']",
    ],
)
def test_hostile_files_are_errors(text: str, tmp_path: Path) -> None:
    (tmp_path / "law_a.yaml").write_text(text, encoding="utf-8")

    with pytest.raises(LawFileError):
        read_law(tmp_path / "law_a.yaml")
