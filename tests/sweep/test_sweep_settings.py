"""What `--set` says is read as YAML has it, and changes the keys of the scenario that it names, and no others."""

import pytest

from cmr.sweep.settings import SettingError, combinations, setting_of, with_settings


def test_a_setting_is_read_with_its_values_as_yaml_has_them() -> None:
    setting = setting_of("robots.10.behaviour.gap=0.3, 1e-3,2,true,wide,[1, 2]")
    assert setting.path == "robots.10.behaviour.gap"
    assert setting.values == (0.3, 0.001, 2, True, "wide", [1, 2])
    assert [type(value) for value in setting.values] == [float, float, int, bool, str, list]
    assert setting_of("geofence=null,[[0, 0], [1, 0], [1, 1]]").values == (None, [[0, 0], [1, 0], [1, 1]])
    assert setting_of("robots.1.start={x: 1, y: 2},[1, 2]").values == ({"x": 1, "y": 2}, [1, 2])


def test_the_seed_is_varied_by_its_option_alone() -> None:
    with pytest.raises(SettingError, match="seed: is varied by --seeds"):
        setting_of("seed=1,2")


@pytest.mark.parametrize("text", ["gap", "=1", "a..b=1", "gap=", "gap=1,,2", "gap=1,1", "gap=[1,{"])
def test_a_setting_that_is_none_is_refused_with_its_key(text: str) -> None:
    with pytest.raises(SettingError, match="gap" if "gap" in text else "key=value"):
        setting_of(text)


def test_every_combination_of_values_comes_once() -> None:
    settings = [setting_of("duration=1,2"), setting_of("rate=20,50,100")]
    found = combinations(settings)
    assert len(found) == len({tuple(values.items()) for values in found}) == 6
    assert combinations([]) == [{}]
    with pytest.raises(SettingError, match="rate: is set twice"):
        combinations([settings[1], settings[1]])


def test_settings_leave_the_document_as_it_was() -> None:
    document = {"robots": [{"id": 1, "behaviour": "follow,gap=0.5"}]}
    changed = with_settings(document, {"robots.1.behaviour.gap": 0.7})
    assert document == {"robots": [{"id": 1, "behaviour": "follow,gap=0.5"}]}
    assert changed == {"robots": [{"id": 1, "behaviour": {"name": "follow", "gap": 0.7}}]}


def test_a_setting_that_is_called_name_stays_beside_the_name_of_the_behaviour() -> None:
    document = {"robots": [{"id": 1, "behaviour": "manoeuvre,name=spins,speed=1"}]}
    for key, value in (("speed", 0.5), ("settings.name", "steps")):
        (robot,) = with_settings(document, {f"robots.1.behaviour.{key}": value})["robots"]
        given = robot["behaviour"]
        assert (given["name"], given["speed"], given["settings"]["name"]) == (
            "manoeuvre",
            0.5 if key == "speed" else "1",
            "spins" if key == "speed" else "steps",
        )
