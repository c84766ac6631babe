"""A profile is read as it is written, or refused with the line that is wrong."""

import math
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from cmr.cli.errors import CommandError
from cmr.tracker.command import main
from cmr.tracker.profile import AXES, EXAMPLE, KINDS, UNITS, Carried, Profile, ProfileError

LEAST = "schema: 1\ntracker: {type: vrpn, server: hall}\nrobots: {0: {body: a}}\n"
names = st.text("abcdefghijklmnopqrstuvwxyz_0123456789", min_size=1, max_size=12).map(lambda text: f"b{text}")
metres = st.floats(-5.0, 5.0, allow_nan=False)
bodies = st.builds(
    lambda body, x, y, theta: {"body": body, "x": x, "y": y, "theta": theta},
    names,
    metres,
    metres,
    st.floats(-math.pi, math.pi),
)


def test_the_example_is_a_profile() -> None:
    profile = Profile.parse(EXAMPLE)
    assert profile.tracker.type == "optitrack"
    assert profile.robots[0] == Carried("robot_0")
    assert profile.robots[1].theta == pytest.approx(math.pi / 2, abs=1e-3)


def test_what_a_profile_leaves_out_has_its_usual_value() -> None:
    profile = Profile.parse(LEAST)
    assert profile.tracker.metres == 1.0
    assert profile.tracker.up == "z"
    assert profile.limits.speed == 1.5


@settings(deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    up=st.sampled_from(AXES),
    unit=st.sampled_from(list(UNITS)),
    robots=st.dictionaries(st.integers(0, 10_000), bodies, min_size=1, max_size=5),
)
def test_a_profile_says_what_was_written(kind: str, up: str, unit: str, robots: dict[int, dict[str, object]]) -> None:
    content = {"schema": 1, "tracker": {"type": kind, "server": "s", "up": up, "unit": unit}, "robots": robots}
    text = yaml.safe_dump(content)
    if len({robot["body"] for robot in robots.values()}) < len(robots):
        with pytest.raises(ProfileError, match="of another robot"):
            Profile.parse(text)
        return
    profile = Profile.parse(text)
    assert (profile.tracker.type, profile.tracker.up, profile.tracker.metres) == (kind, up, UNITS[unit])
    assert profile.robots == {robot_id: Carried(**robot) for robot_id, robot in robots.items()}  # type: ignore[arg-type]


@settings(deadline=None)
@given(st.text(max_size=200))
def test_any_text_is_a_profile_or_refused_with_its_place(text: str) -> None:
    said = ""
    try:
        Profile.parse(text)
    except ProfileError as error:
        said = str(error)
    assert said.startswith("profile: line ")  # no such text is one


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (LEAST.replace("vrpn", "kinect"), "line 2: tracker.type must be one of optitrack"),
        (LEAST.replace("schema: 1", "schema: 2"), "line 1: schema is not 1"),
        (LEAST.replace("{body: a}", "{}"), "line 3: robots.0 body is missing"),
        (LEAST.replace("0:", "-1:"), "line 3: robots.-1 is no robot id"),
        (LEAST.replace("{0: {body: a}}", "{}"), "line 3: robots names no robot"),
        (LEAST.replace("server: hall", "server: hall, lag: 3"), "line 2: tracker.lag must be"),
        (LEAST + "axes: z\n", "line 4: axes is not known here"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(wrong: str, said: str) -> None:
    with pytest.raises(ProfileError) as error:
        Profile.parse(wrong)
    assert said in str(error.value)


def test_a_profile_is_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "tracker.yaml"
    assert main(["--write-profile", str(path)]) == 0
    assert Profile.load(path) == Profile.parse(EXAMPLE)
    assert "Fill in" in capsys.readouterr().out
    with pytest.raises(CommandError, match="not written over"):
        main(["--write-profile", str(path)])


def test_without_a_profile_the_command_says_how_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="--write-profile"):
        main(["--profile", str(tmp_path / "none.yaml")])
