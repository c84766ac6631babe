"""Emulated robots with chosen mistakes, for the tests of bring-up."""

import sys

from robot_driver.simulated.bringing_up import Person
from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from studies.bringup_robots import Case, case_of, mounting_of, verdict

__all__ = ["robot", "verdict"]

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
SMALL = {"motor_gain_asymmetry": 0.02, "turn_slip": 0.003, "coulomb_friction": 2.0}
FLAGS = dict.fromkeys(
    ("motors", "left", "right", "encoders", "left_against", "right_against", "left_dead", "right_dead"), False
)


def robot(
    *wrong: str,
    flags: tuple[str, ...] = (),
    gyro: float = 1.0,
    controller: str = "roboclaw",
    stated: int = 2048,
    ticks: int = 2048,
    held: float = 0.0,
    stop: bool = False,
    miscounts: float = 0.0,
) -> Case:
    """A robot with these mistakes; `held` is the duty by which dry friction holds it, a gyro of 0 is absent."""
    effects = SMALL | ({"static_friction": held * ROBOT["k2_over_k3"]} if held else {})
    return case_of(
        "",
        robot=ROBOT,
        effects=effects,
        mounting=mounting_of(FLAGS | dict.fromkeys(flags, True), gyro or 1.0),
        wrong=wrong,
        controller=controller,
        gyro="dsp3000" if gyro and controller != "mbot" else None,
        ticks=ticks,
        person=Person(0.04, 0.158, stated, has_gyro=gyro != 0.0, measures_stop=stop, miscounts=miscounts),
        seed=3,
        offset=1.5708,
    )
