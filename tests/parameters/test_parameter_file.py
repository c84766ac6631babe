"""The parameter file is never half there, is refused with its place when wrong, and is followed within a second."""

import math
import os
import random
import re
import time
from datetime import datetime, timezone
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.cli.configuration import LARGEST_ROBOT_ID
from cmr.model.catalogue import CATALOGUE, DEFINITIONS
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.parameters import ParameterDefinition, RobotParameters
from cmr.parameters.file import ParameterFile, ParameterFileError, Value, load, parse
from tests.support.saving import saver

# The example of interfaces.md, section 3, letter for letter.
EXAMPLE = """schema: 1
robot_id: 0
written: 2026-01-31T12:00:00Z
parameters:              # name: {value, unit, std}; a name absent = its neutral value; an unknown name = an error
  wheel_radius: {value: 0.04, unit: m}
  k2_over_k3:   {value: 118.0, unit: rad/s^2, std: 0.8}
  k1:           {value: 0.054, unit: s/rad, std: 0.0002}
  base_width:   {value: 0.161, unit: m, std: 0.0006}
effects: []              # names of the extended effects in use, each with its parameters above
provenance: {log: run.lcm, sha256: ..., method: grid+refine, samples: 6000, path_rmse_m: 0.012, held_out_path_rmse_m: 0.014}
"""  # noqa: E501
EXTENDED = EXAMPLE.replace(
    "effects: []",
    """  gyro_bias: {value: 0.01, unit: rad/s, std: 0.0002}
  surface_change_k1: {value: 0.05, unit: '-'}
  surface_change_time: {value: 60.0, unit: s}
effects: [surface_change, gyro_bias]""",
)


def with_radius(radius: float, robot_id: int = 0) -> ParameterFile:
    return ParameterFile(robot_id, {"wheel_radius": Value(radius)})


def values_of(definition: ParameterDefinition) -> st.SearchStrategy[Value]:
    std = st.none() | st.floats(0.0, 1e300)
    return st.builds(Value, st.floats(definition.lower, definition.upper), std)


@st.composite
def parameter_files(draw: st.DrawFn) -> ParameterFile:
    values = {}
    for name in draw(st.lists(st.sampled_from(sorted(PAPER)), unique=True)):
        values[name] = draw(values_of(DEFINITIONS[name]))
    effects = draw(st.lists(st.sampled_from(sorted(CATALOGUE)), unique=True, max_size=8))
    for name in effects:
        for parameter in draw(st.lists(st.sampled_from(CATALOGUE[name].parameters), unique=True, min_size=1)):
            values[parameter.name] = draw(values_of(parameter))
    scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text()
    provenance = draw(st.dictionaries(st.text(), scalars | st.lists(scalars, max_size=3), max_size=4))
    written = draw(st.datetimes(datetime(1970, 1, 1), datetime(2200, 1, 1), timezones=st.just(timezone.utc)))
    return ParameterFile(
        draw(st.integers(0, LARGEST_ROBOT_ID)),
        values,
        tuple(effects),
        provenance,
        written.replace(microsecond=0),
    )


@pytest.mark.slow
@given(parameter_files())
def test_what_is_written_is_read_back_the_same(file: ParameterFile) -> None:
    text = file.to_yaml()
    assert parse(text) == file
    assert parse(text).to_yaml() == text


@pytest.mark.slow
@given(parameter_files())
def test_the_model_gets_every_parameter_of_the_file(file: ParameterFile) -> None:
    complete = ParameterFile(0, {**{name: Value(1.0) for name in PAPER}, **file.values}, file.effects)
    assert complete.robot_parameters.values == {name: value.value for name, value in complete.values.items()}
    assert tuple(complete.robot_parameters) == tuple(complete.value(name) for name in PAPER)


@given(st.sets(st.sampled_from(sorted(CATALOGUE)), min_size=1))
def test_neutral_parameters_of_effects_may_be_there_without_the_effects_being_in_use(names: set[str]) -> None:
    neutral = {p.name: Value(p.neutral) for name in names for p in CATALOGUE[name].parameters if p.neutral is not None}
    file = ParameterFile(0, {"wheel_radius": Value(0.04), **neutral})
    assert parse(file.to_yaml()) == file


def test_what_is_saved_is_loaded_back_the_same_and_others_can_read_it(tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "robot_0.yaml"
    file = parse(EXAMPLE)
    file.save(path)
    assert load(path) == file
    assert path.stat().st_mode & 0o777 == 0o644
    assert [entry.name for entry in path.parent.iterdir()] == ["robot_0.yaml"]


def test_the_example_of_the_interface_is_read_as_it_stands_there() -> None:
    file = parse(EXAMPLE)
    assert (file.robot_id, file.effects, file.provenance["samples"]) == (0, (), 6000)
    assert file.values == {
        "wheel_radius": Value(0.04),
        "k2_over_k3": Value(118.0, 0.8),
        "k1": Value(0.054, 0.0002),
        "base_width": Value(0.161, 0.0006),
    }
    assert file.written == datetime(2026, 1, 31, 12, tzinfo=timezone.utc)
    assert file.robot_parameters == RobotParameters(0.04, 118.0, 0.054, 0.161)


def test_a_file_of_the_papers_model_is_a_valid_extended_one() -> None:
    file, extended = parse(EXAMPLE), parse(EXTENDED)
    assert extended.effects == ("surface_change", "gyro_bias")
    assert extended.values["gyro_bias"] == Value(0.01, 0.0002)
    effects = {"gyro_bias": 0.01, "surface_change_k1": 0.05, "surface_change_time": 60.0}
    assert extended.robot_parameters == RobotParameters.of({**file.robot_parameters.values, **effects})


def test_our_writing_looks_like_the_example() -> None:
    def squeeze(text: str) -> str:
        return re.sub(r" +", " ", re.sub(r" +#.*", "", text))

    for example in (EXAMPLE, EXTENDED):
        text = example.replace("sha256: ...", "sha256: 1f3a")
        assert squeeze(parse(text).to_yaml()) == squeeze(text)


def test_an_unknown_name_is_an_error_that_lists_the_known_ones() -> None:
    with pytest.raises(ParameterFileError, match="unknown name 'k4'") as error:
        parse(EXAMPLE.replace("  k1: ", "  k4: "), "robot_0.yaml")
    assert all(name in str(error.value) for name in DEFINITIONS)
    with pytest.raises(ParameterFileError, match="unknown name 'k4'"):
        ParameterFile(0, {"k4": Value(1.0)})


@pytest.mark.parametrize(
    ("before", "after", "place"),
    [
        ("unit: s/rad", "unit: rad/s", r"parameters: k1: unit is 'rad/s', must be 's/rad'"),
        ("value: 0.054", "value: .nan", r"parameters: k1: value is nan"),
        ("value: 0.054", "value: .inf", r"parameters: k1: value is inf"),
        ("value: 0.054", "value: -0.054", r"parameters: k1: value is -0.054, must be a number between"),
        ("value: 0.054", "value: 0", r"parameters: k1: value is 0"),
        ("value: 0.054", "value: fast", r"parameters: k1: value is 'fast'"),
        ("value: 0.054", "value: true", r"parameters: k1: value is True"),
        ("value: 0.054", "value: [0.054]", r"parameters: k1: value is \[0.054\]"),
        ("value: 0.054", f"value: 1{'0' * 400}", r"parameters: k1: value is 1000"),
        ("value: 0.054, ", "", r"parameters: k1: must be \{value: number, unit: s/rad\}"),
        ("{value: 0.054, unit: s/rad, std: 0.0002}", "0.054", r"parameters: k1: must be \{value"),
        ("std: 0.0002", "std: -1", r"parameters: k1: std is -1"),
        ("std: 0.0002", "std: .nan", r"parameters: k1: std is nan"),
        ("std: 0.0002", "sdt: 0.0002", r"parameters: k1: must be"),
        ("schema: 1\n", "", r"schema is None"),
        ("schema: 1\n", "schema: 2\n", r"schema is 2; this version reads schema 1"),
        ("robot_id: 0\n", "", r"robot_id: must be a whole number .*None"),
        ("robot_id: 0\n", "robot_id: -1\n", r"robot_id: must be a whole number .*-1"),
        ("robot_id: 0\n", "robot_id: 2147483648\n", r"robot_id: must be a whole number .*2147483648"),
        ("robot_id: 0\n", "robot_id: zero\n", r"robot_id: must be a whole number .*'zero'"),
        ("written: 2026-01-31T12:00:00Z\n", "", r"written: must be a time such as"),
        ("2026-01-31T12:00:00Z", "yesterday", r"yesterday"),
        ("2026-01-31T12:00:00Z", "2026-13-31T12:00:00Z", r"month must be in 1..12"),
        ("effects: []", "effects: [back_lash]", r"effects: unknown effect 'back_lash'"),
        ("effects: []", "effects: [[backlash]]", r"effects: unknown effect \['backlash'\]; known are .*backlash"),
        ("effects: []", "effects: backlash", r"effects: must be a list, not 'backlash'"),
        ("effects: []", "efects: []", r"unknown key 'efects'"),
        ("provenance: {log", "provenance: [{log", r"cannot be read"),
        ("parameters:  ", "parameters: 5 #", r"cannot be read"),
    ],
)
def test_what_is_wrong_is_an_error_that_names_file_and_place(before: str, after: str, place: str) -> None:
    assert_refused(EXAMPLE, before, after, place)


@pytest.mark.parametrize(
    ("before", "after", "place"),
    [
        ("unit: rad/s,", "unit: deg/s,", r"parameters: gyro_bias: unit is 'deg/s', must be 'rad/s'"),
        ("value: 0.05,", "value: 50.0,", r"parameters: surface_change_k1: value is 50.0, must be .* -0.9 and 5 -"),
        ("value: 0.05,", "value: .inf,", r"parameters: surface_change_k1: value is inf"),
        ("change, gyro_bias]", "change]", r"gyro_bias: belongs to the effect gyro_bias, which effects does not name"),
        (
            "change, gyro_bias]",
            "change, gyro_bias, gyro_scale]",
            r"gyro_scale is in use, but parameters lacks gyro_scale",
        ),
        ("change, gyro_bias]", "change, slope, gyro_bias]", r"slope is in use, but parameters lacks slope_x, slope_y"),
        ("change, gyro_bias]", "change, gyro_bias, gyro_bias]", r"effects: gyro_bias is there more than once"),
        (
            "surface_change_k1:",
            "surface_change_k2:",
            r"unknown name 'surface_change_k2'; known are .*surface_change_k1",
        ),
    ],
)
def test_what_is_wrong_with_effects_is_an_error_that_names_file_and_place(before: str, after: str, place: str) -> None:
    assert_refused(EXTENDED, before, after, place)


def assert_refused(text: str, before: str, after: str, place: str) -> None:
    assert before in text
    with pytest.raises(ParameterFileError, match=rf"^/etc/robot_0\.yaml: .*{place}"):
        parse(text.replace(before, after, 1), "/etc/robot_0.yaml")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "not a YAML mapping"),
        (b"\n# nothing yet\n", "not a YAML mapping"),
        (b"just a sentence", "not a YAML mapping"),
        (b"- a\n- list\n", "not a YAML mapping"),
        (b"services: {web: {image: nginx}}\n", "schema is None"),
        (b"a: !!python/object/apply:os.system [true]\n", "cannot be read"),
        (b"a: *nobody\n", "cannot be read"),
        (b"{" * 3_000, "cannot be read"),
        (b"[" * 3_000 + b"]" * 3_000, "cannot be read"),
        (bytes(range(256)), "cannot be read"),
        (b"\x7fELF\x02\x01\x01\x00", "cannot be read"),
        (b"schema: 1\nrobot_id: 0\nwritten: 2026-01-31T12:00:00Z\n", "parameters: must be a mapping"),
        (EXAMPLE.encode()[:200], "cannot be read"),
        (EXAMPLE.replace("{log: run.lcm", "5 # ").encode(), "provenance: must be a mapping"),
    ],
)
def test_a_foreign_empty_or_broken_file_is_an_error_that_names_it(content: bytes, why: str, tmp_path: Path) -> None:
    path = tmp_path / "robot_0.yaml"
    path.write_bytes(content)
    with pytest.raises(ParameterFileError, match=f"^{re.escape(str(path))}: .*{why}"):
        load(path)


@pytest.mark.parametrize("name", ["missing.yaml", "."])
def test_a_file_that_cannot_be_opened_is_an_error_that_names_it(name: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterFileError, match=f"^{re.escape(str(tmp_path / name))}: cannot be read"):
        load(tmp_path / name)


@given(st.text() | st.binary().map(lambda data: data.decode("latin-1")))
def test_any_text_is_read_or_refused_and_nothing_else(text: str) -> None:
    for content in (text, EXAMPLE + text, EXAMPLE.replace("0.161", text, 1)):
        try:
            parse(content, "robot_0.yaml")
        except ParameterFileError as error:
            said = str(error)
        else:
            continue
        assert said.startswith("robot_0.yaml: ")


def test_a_value_that_the_file_lacks_is_named() -> None:
    file = with_radius(0.04)
    assert file.has("wheel_radius")
    assert not file.has("wheel_radius", "k1")
    with pytest.raises(ParameterFileError, match="k2_over_k3 is missing; the file has wheel_radius"):
        file.robot_parameters


# Atomic writing


@pytest.mark.slow
def test_a_kill_at_any_moment_and_a_reader_at_any_moment_find_a_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "robot_0.yaml"
    moments = random.Random(1)
    reads = 0
    for _ in range(30):
        path.unlink(missing_ok=True)
        with saver(path):
            deadline = time.monotonic() + 20.0
            while not path.exists():
                assert time.monotonic() < deadline
                time.sleep(0.001)
            end = time.monotonic() + moments.uniform(0.0, 0.05)
            while time.monotonic() < end:
                assert_whole(load(path))
                reads += 1
        assert_whole(load(path))
    assert reads > 30


def assert_whole(file: ParameterFile) -> None:
    """All parts are of the same version, and the last is complete."""
    count, padding = file.provenance["count"], file.provenance["padding"]
    assert isinstance(count, int)
    assert isinstance(padding, str)
    assert file.value("wheel_radius") == count * 1e-9 + 0.01
    assert len(padding) == count * 997 % 20_000


def test_a_folder_that_cannot_be_written_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "robot_0.yaml"
    with_radius(0.04).save(path)
    tmp_path.chmod(0o555)
    try:
        if os.access(tmp_path, os.W_OK):
            pytest.skip("permissions do not bind root")
        with pytest.raises(PermissionError):
            with_radius(0.05).save(path)
    finally:
        tmp_path.chmod(0o755)
    assert load(path).value("wheel_radius") == 0.04


def test_a_disk_that_fails_leaves_the_old_file_and_no_litter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "robot_0.yaml"
    with_radius(0.04).save(path)

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        with_radius(0.05).save(path)
    assert load(path).value("wheel_radius") == 0.04
    assert [entry.name for entry in tmp_path.iterdir()] == ["robot_0.yaml"]


def test_the_content_is_on_the_disk_before_the_name_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, order = tmp_path / "robot_0.yaml", []
    sync = os.fsync

    def note(descriptor: int) -> None:
        order.append((path.exists(), os.fstat(descriptor).st_size))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", note)
    file = with_radius(0.04)
    file.save(path)
    assert order[0] == (False, len(file.to_yaml()))


def test_numbers_have_bounds_that_no_wheeled_robot_reaches() -> None:
    for definition in PAPER.values():
        assert 0.0 < definition.lower < definition.upper < math.inf
