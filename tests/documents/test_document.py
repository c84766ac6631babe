"""Promises of the one reader of YAML: whatever is wrong is named with file, line and key."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
import yaml

from cmr.documents import bounds
from cmr.documents.declared import Between, Word
from cmr.documents.document import DocumentError, Item, read, read_file
from cmr.documents.structure import Names, structured
from cmr.parameters.file import ParameterFileError, parse
from robot_driver.emulator.settings import SettingsError, load_settings


@dataclass(frozen=True)
class Wheel:
    radius: float
    ticks: Annotated[int, Between(1, 4096)] = 2048

    def __post_init__(self) -> None:
        if self.radius <= 0.0:
            raise DocumentError("must be more than 0", "radius")


@dataclass(frozen=True)
class Robot:
    wheel: Wheel
    name: str | None = None
    kind: Annotated[str, Word(lambda: ("real", "virtual"))] = "real"
    effects: Annotated[dict[str, float], Names(("slip", "drag"))] | None = None


def of(text: str) -> Item:
    return read(text, "robot.yaml", DocumentError)


def test_a_dataclass_is_what_its_file_may_say() -> None:
    text = "wheel:\n  radius: 0.05\nname: 7\nkind: virtual\neffects: {slip: .inf}\n"
    assert structured(of(text), Robot) == Robot(Wheel(0.05), "7", "virtual", {"slip": float("inf")})
    assert structured(of("wheel: {radius: 1, ticks: 8}\nname: null"), Robot) == Robot(Wheel(1.0, 8))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: a\n", "line 1: wheel is missing"),
        ("name: a\nwheel:\n  ticks: 3\n", "line 2: wheel: radius is missing"),
        ("wheel:\n  radius: wide\n", "line 2: wheel.radius: must be a finite number, not 'wide'"),
        ("wheel:\n  radius: -1\n", "line 2: wheel.radius: must be more than 0"),
        ("wheel: {radius: 1,\n  ticks: 5000}\n", "line 2: wheel.ticks: must be a whole number from 1 to 4096"),
        ("wheel: {radius: 1}\nkind: big\n", "line 2: kind: must be one of real, virtual, not 'big'"),
        ("wheel: {radius: 1}\n\nsize: 1\n", "line 3: size: is not known here. Known are: wheel, name, kind, effects"),
        ("wheel: {radius: 1}\nwheel: {radius: 1}\n", "line 2: wheel: is there twice"),
        ("wheel: {radius: 1}\neffects:\n  slip: much\n", "line 3: effects.slip: must be a number, not 'much'"),
        ("wheel: {radius: 1}\neffects:\n  slop: 1\n", "line 3: effects.slop: is not known here. Known are: slip, drag"),
        ("wheel: {radius: !!int no}\n", "line 1: wheel.radius: cannot be read: "),
        ("wheel:\n\tradius: 1\n", r"line 2: is not YAML: found character '\t'"),
        ("wheel: &w {<<: *w}\n", "line 1: wheel: << names a mapping that takes in itself"),
    ],
)
def test_what_is_wrong_is_named_with_file_line_and_key(text: str, said: str) -> None:
    with pytest.raises(DocumentError) as error:
        structured(of(text), Robot)
    assert str(error.value).startswith(f"robot.yaml: {said}")


def test_a_mapping_takes_in_another_as_yaml_says() -> None:
    text = "wheel: &wheel {radius: 1, ticks: 5}\nother:\n  <<: *wheel\n  ticks: 9\n"
    assert structured(dict(of(text).entries())["other"], Wheel) == Wheel(1.0, 9)


def test_values_laid_over_others_are_named_in_their_own_file(tmp_path: Path) -> None:
    below, above = tmp_path / "below.yaml", tmp_path / "above.yaml"
    below.write_text("wheel:\n  radius: 1\n  ticks: 0\n")
    above.write_text("# mine\nwheel: {radius: 2}\n")
    item = read_file(above, DocumentError).over(read_file(below, DocumentError))
    with pytest.raises(DocumentError, match=r"below\.yaml: line 3: wheel\.ticks"):
        structured(item, Robot)
    above.write_text("# mine\nwheel: {ticks: 2}\n")
    item = read_file(above, DocumentError).over(read_file(below, DocumentError))
    assert structured(item, Robot) == Robot(Wheel(1.0, 2))


def test_settings_of_the_emulated_robot_are_named_with_their_line(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    for text, said in [
        ("seed: 1\nrobot:\n  k1: -1\n", r"line 3: robot\.k1 must be greater than 0"),
        ("effects:\n  backlash: 0.1\n  command_loss: 2\n", r"line 3: effects\.command_loss must be 0 to 1, not 2"),
        ("imperfections:\n  battery_sag: {size: 3}\n", r"line 2: imperfections\.battery_sag\.size must be 0 to 0\.5"),
    ]:
        path.write_text(text)
        with pytest.raises(SettingsError, match=rf"robot\.yaml: {said}"):
            load_settings(path)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("k1:", "k9:", "line 6: parameters: unknown name 'k9'; known are"),
        ("value: 0.054", "value: -1", "line 6: parameters: k1: value is -1, must be a number between"),
        ("effects: []", "efects: []", "line 7: unknown key 'efects'"),
        ("schema: 1", "schema: 2", "line 1: schema is 2; this version reads schema 1"),
        ("robot_id: 0", "robot_id: zero", "line 2: robot_id: must be a whole number"),
        ("effects: []", "effects: [nothing]", "line 7: effects: unknown effect 'nothing'"),
        ("effects: []", "robot_id: 1", "line 7: robot_id: is there twice"),
    ],
)
def test_what_is_wrong_with_a_parameter_file_is_named_with_its_line(before: str, after: str, said: str) -> None:
    text = "schema: 1\nrobot_id: 0\nwritten: 2026-01-31T12:00:00Z\nparameters:\n"
    text += "  wheel_radius: {value: 0.04, unit: m}\n  k1: {value: 0.054, unit: s/rad}\neffects: []\n"
    assert parse(text).value("k1") == 0.054
    with pytest.raises(ParameterFileError) as error:
        parse(text.replace(before, after), "robot_0.yaml")
    assert str(error.value).startswith(f"robot_0.yaml: {said}")


@pytest.mark.parametrize("loader", [bounds.LOADER, yaml.SafeLoader], ids=["C", "Python"])
@pytest.mark.parametrize("text", ["[" * 10_000, "{" * 3_000, "[" * 3_000 + "]" * 3_000, "a: {b: [" * 300])
def test_what_is_nested_too_deeply_is_refused_at_once(text: str, loader: type, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounds, "LOADER", loader)
    began = time.process_time()
    with pytest.raises(DocumentError, match=r"robot\.yaml: line 1: is not YAML: nested too deeply, more than 50"):
        of(text)
    assert time.process_time() - began < 2.0  # of the first it took a minute to find an end
