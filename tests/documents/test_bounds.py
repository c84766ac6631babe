"""What strangers write as YAML costs little, whatever it is, and is refused with file, line and why."""

import os
import time
from pathlib import Path

import pytest

from cmr.documents.document import DocumentError, read, read_file
from cmr.parameters.file import ParameterFileError, load, parse
from tests.parameters.test_parameter_file import with_radius

QUICK = 1.0  # s of computing; today's least takes some milliseconds
# 376 bytes that stand for 170 million values.
MULTIPLYING = "\n".join(
    ["a: &a0 [x,x,x,x,x,x,x,x,x,x]"]
    + [f"b{k}: &a{k} [{','.join([f'*a{k - 1}'] * 8)}]" for k in range(1, 9)]
    + ["schema: *a8"]
)

COLLIDING = ", ".join(f"{(2**61 - 1) * k}: 1" for k in range(9_000))  # all with the same hash


def refused(text: str, kind: type[DocumentError] = ParameterFileError) -> str:
    """Return how a text is refused, which costs little."""
    began = time.process_time()
    with pytest.raises(kind) as error:
        parse(text, "robot_0.yaml") if kind is ParameterFileError else read(text, "robot_0.yaml", kind)
    assert time.process_time() - began < QUICK
    return str(error.value)


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        (MULTIPLYING, 2, "aliases (*name) and tags (!name) are not read here"),
        ("schema: !!int 1\n", 1, "aliases (*name) and tags (!name) are not read here"),
        ("schema: &a {b: *a}\n", 1, "an alias (*) stands for what it is inside of"),
        ("schema: 1\nprovenance: [" + "[]," * 80_000 + "]\n", 2, "holds more than 20000 values"),
        ("schema: 1\nprovenance: [" + "[]," * 80_000, 2, "holds more than 20000 values"),
        (
            "schema: {" + ", ".join(f"{(2**61 - 1) * k}: 1" for k in range(9_000)) + "}\n",
            1,
            "more than 200 numbers as keys",
        ),
        ("schema: " + "x" * 300_000, 1, "is larger than 0.256 MB"),
        ("schema: 0x" + "f" * 200_000, 1, "a number of 200002 characters"),
        ("schema: 1" + ":59" * 80_000, 1, "a number of 240001 characters"),
    ],
)
def test_a_parameter_file_that_would_cost_much_is_refused_at_once(text: str, line: int, said: str) -> None:
    words = refused(text)
    assert words.startswith(f"robot_0.yaml: line {line}: ")
    assert said in words
    assert len(words) < 200


@pytest.mark.parametrize(
    "text", ["schema: " + "x" * 200_000, "schema: 1\n" + "x" * 100_000 + ": 1\n", 'schema: "\\e]0;owned\\a\\x9b2J"']
)
def test_an_error_does_not_repeat_a_long_text_and_nothing_that_a_terminal_obeys(text: str) -> None:
    words = refused(text)
    assert words.isprintable()
    assert len(words) < 400


def test_brackets_that_stand_where_no_list_may_begin_are_refused_quickly() -> None:
    # The error comes before the depth is seen; fuzzing of the bus held a simulator up for 15 s with it.
    assert "line 2: cannot be read" in refused("schema: 1\nk1: {value:" + "[" * 3000 + "m}\n")


def test_aliases_of_other_files_count_as_what_they_stand_for() -> None:
    assert "line 6: is not YAML: holds more than 300000 values" in refused(MULTIPLYING, DocumentError)
    deep = "a0: &a0 [x]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}]\n" for k in range(1, 3000))
    assert "nested too deeply, more than 50" in refused(deep, DocumentError)
    assert read("place: &p {x: 1}\nother: *p\n", "s.yaml", DocumentError).value == {
        "place": {"x": 1},
        "other": {"x": 1},
    }


def test_a_key_that_is_there_twice_is_refused_also_inside_of_a_list() -> None:
    text = with_radius(0.04).to_yaml().replace("provenance: {}", "provenance: {logs: [{a: 1, a: 2}]}")
    assert refused(text).endswith("provenance: logs[0]: a: is there twice")


def test_what_is_in_two_places_of_a_file_is_written_twice() -> None:
    logs = {"name": "run.lcm"}
    file = with_radius(0.04)
    text = type(file)(0, file.values, provenance={"fitted": [logs], "tested": [logs]}).to_yaml()
    assert parse(text).provenance == {"fitted": [logs], "tested": [logs]}


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "large"])
def test_only_regular_files_that_are_not_too_large_are_read(kind: str, tmp_path: Path) -> None:
    path = Path("/dev/zero") if kind == "device" else tmp_path / "robot_0.yaml"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "large":
        with path.open("wb") as stream:
            stream.truncate(10**11)  # it takes no space
    why = {"large": "it is larger than", "folder": "Is a directory"}.get(kind, "it is no regular file")
    with pytest.raises(ParameterFileError, match=f"{path}: cannot be read: {why}"):
        load(path)
    with pytest.raises(DocumentError, match=f"{path}: cannot be read: {why}"):
        read_file(path, DocumentError)
