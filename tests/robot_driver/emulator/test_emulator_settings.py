"""Settings are checked once, and an error says which key and what would be right."""

import dataclasses
from pathlib import Path

import pytest

from cmr.plant.parameters import NEUTRAL, RANGES, TYPICAL
from robot_driver.emulator.settings import SettingsError, load_settings

pytestmark = pytest.mark.waits


def written(folder: Path, text: str) -> Path:
    path = folder / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_default_robot_is_the_one_that_is_documented() -> None:
    settings = load_settings()
    assert settings.truth == {"k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
    assert settings.robot.wheel_radius == 0.04
    assert settings.robot.ticks_per_turn == 2048


def test_a_file_says_only_what_differs(tmp_path: Path) -> None:
    path = written(tmp_path, "robot: {k1: 0.06}\nimperfections: {slip_noise: {enabled: true}}\n")
    settings = load_settings(path, seed=5)
    assert (settings.robot.k1, settings.robot.base_width, settings.seed) == (0.06, 0.161, 5)
    assert settings.imperfections.slip_noise.effective == load_settings().imperfections.slip_noise.size


def test_effects_are_hidden_by_name_and_count_instead_of_the_imperfection_of_that_name(tmp_path: Path) -> None:
    settings = load_settings(written(tmp_path, "effects: {backlash: 0.1, coulomb_friction: 7, current_limit: .inf}\n"))
    assert (settings.plant.backlash, settings.plant.coulomb_friction) == (0.1, 7.0)
    assert settings.plant.motor_gain_asymmetry == load_settings().plant.motor_gain_asymmetry != 0.0
    assert settings.plant.turn_slip == settings.imperfections.turn_slip.size
    assert settings.ideal().effects == {}


def test_an_ideal_robot_has_what_its_file_hides_and_nothing_else(tmp_path: Path) -> None:
    path = written(tmp_path, "effects: {backlash: 0.1}\nimperfections: {turn_slip: {enabled: true, size: 0.02}}\n")
    settings = load_settings(path, ideal=True)
    ideal = load_settings().ideal().plant
    assert settings.plant == ideal._replace(backlash=0.1, turn_slip=0.02)
    assert load_settings(ideal=True) == load_settings().ideal()


def test_what_is_typical_and_what_is_neutral_is_possible() -> None:
    sizes = [item for typical in TYPICAL.values() for item in typical.items()]
    for name, value in (*NEUTRAL._asdict().items(), *sizes):
        least, largest = RANGES[name]
        assert least <= value <= largest, name


def test_an_empty_file_is_the_default_robot(tmp_path: Path) -> None:
    assert load_settings(written(tmp_path, "# nothing\n")) == load_settings()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("effects: {backslash: 0.1}", "effects.backslash is unknown. Known are: battery_sag"),
        ("effects: {backlash: wide}", "effects.backlash must be a number, not 'wide'"),
        ("effects: {encoder_quantisation: 0}", "effects.encoder_quantisation must be 1 or more, not 0."),
        ("effects: {gyro_latency: -0.02}", "effects.gyro_latency must be 0 to 10, not -0.02."),
        ("effects: {saturation: -1}", "effects.saturation must be 0.01 to 1, not -1."),
        ("effects: {electrical_lag: -1}", "effects.electrical_lag must be 0 to 10, not -1."),
        ("effects: {command_loss: 2}", "effects.command_loss must be 0 to 1, not 2."),
        ("effects: {coulomb_friction: -5}", "effects.coulomb_friction must be 0 to 1000, not -5."),
        ("effects: {pose_latency: .inf}", "effects.pose_latency must be 0 to 10, not inf."),
        ("effects: {turn_slip: .nan}", "effects.turn_slip must be 0 to 10, not nan."),
        ("imperfections: {battery_sag: {size: 3}}", "imperfections.battery_sag.size must be 0 to 0.5, not 3."),
        ("effects: 3", "effects must be a section with some of: "),
        ("wheel: 3", "wheel is unknown. Known are: seed, robot"),
        ("robot: {wheel_radios: 3}", "robot.wheel_radios is unknown. Known are: wheel_radius"),
        ("imperfections: {gyro_bias: {sise: 1}}", "imperfections.gyro_bias.sise is unknown. Known are: enabled, size"),
        ("robot: 3", "robot must be a section with some of: wheel_radius"),
        ("robot: {k1: '0.05'}", "robot.k1 must be a finite number, not '0.05'"),
        ("robot: {k1: .nan}", "robot.k1 must be a finite number"),
        ("robot: {k1: -1}", "k1 must be greater than 0"),
        ("robot: {k1: true}", "robot.k1 must be a finite number, not True"),
        ("robot: {k2_over_k3: 100000}", "below 500/s"),
        ("seed: 1.5", "seed must be a whole number"),
        ("roboclaw: {status_bytes: 3}", "status_bytes must be 1, 2 or 4"),
        ("roboclaw: {address: 12}", "address must be 0x80 to 0x87"),
        ("dsp3000: {rate: 0}", "rate must be greater than 0"),
        ("imperfections: {turn_slip: {enabled: maybe}}", "imperfections.turn_slip.enabled must be true or false"),
        ("imperfections: {turn_slip: {size: -1}}", "turn_slip.size must be 0 or more"),
        ("[1, 2]", "must be a mapping"),
        ("robot: {", "cannot be read"),
    ],
)
def test_a_mistake_is_named_with_its_remedy(tmp_path: Path, text: str, said: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(SettingsError) as error:
        load_settings(path)
    assert str(error.value).startswith(f"{path}: ")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="No such file"):
        load_settings(tmp_path / "absent.yaml")


def test_the_ideal_robot_keeps_only_the_noise_of_measurement() -> None:
    imperfections = load_settings().ideal().imperfections
    enabled = {field.name for field in dataclasses.fields(imperfections) if getattr(imperfections, field.name).enabled}
    assert enabled == {"encoder_quantisation", "gyro_noise", "pose_noise"}


def test_settings_cannot_be_changed_after_they_were_checked() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        load_settings().robot.k1 = 1.0  # type: ignore[misc]
