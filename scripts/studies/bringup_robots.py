"""Random robots for bring-up, with faults in wiring and poses, and the verdict on the settings that bring-up finds."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from robot_driver.emulator.settings import Cameras, Mounting, Settings, load_settings
from robot_driver.simulated.bringing_up import Outcome, Person, SimulatedBringup

CONTROLLERS = ("roboclaw", "roboteq", "mbot")
TICKS = (1200, 2048, 3744, 4480, 8400)
# Keys: ticks of the data sheet divided by the true ticks (0: unknown), and factor of the gyro (0: no gyro). Values:
# their probabilities.
STATED = {1.0: 0.4, 2.0: 0.15, 0.5: 0.1, 4.0: 0.15, 0.25: 0.05, 0.0: 0.15}
GYROS = {1.0: 0.4, -1.0: 0.25, 0.5: 0.2, 0.0: 0.15}
POSES = ("right", "mirrored", "rotated", "y up", "mm", "degrees", "late", "other body", "swapped", "offset")
STATIC_FRICTION = (0.11, 0.17)  # range of the duty at which robots with static friction begin to move
EFFECTS_AT_ONCE = 6
TICKS_TOLERANCE = 0.01  # relative
ANGLE, POINT, LATENESS = math.radians(5.0), 0.02, 0.04  # tolerances of the poses [rad, m, s]
RADIAN = 180.0 / math.pi


@dataclass(frozen=True)
class Case:
    """A robot, the names of the faults in its poses, and its simulated bring-up."""

    name: str
    wrong: tuple[str, ...]
    bringup: SimulatedBringup

    @property
    def settings(self) -> Settings:
        """The emulated robot."""
        return self.bringup.settings


def random_case(number: int, seed: int) -> Case:
    """Return random robot `number` of a study with this seed."""
    random = np.random.default_rng([seed, number, 24])
    controller = str(random.choice(CONTROLLERS))
    factor = float(random.choice(list(GYROS), p=list(GYROS.values())))
    if controller == "mbot" and factor == 0.0:
        factor = 1.0  # its board has a gyro
    robot, effects = _robot_with_effects(random)
    ticks, stated = int(random.choice(TICKS)), float(random.choice(list(STATED), p=list(STATED.values())))
    if random.random() < 0.2:
        effects["static_friction"] = float(random.uniform(*STATIC_FRICTION)) * robot["k2_over_k3"]
    wrong = [str(random.choice(POSES))]
    if random.random() < 0.3:
        wrong.append(str(random.choice(("mirrored", "rotated", "mm", "degrees", "late", "offset"))))
    flags = {name: bool(random.random() < share) for name, share in MOUNTED.items()}
    return case_of(
        f"{number}",
        robot=robot,
        effects=effects,
        mounting=mounting_of(flags, factor or 1.0),
        wrong=tuple(dict.fromkeys(wrong)),
        controller=controller,
        gyro=None if controller == "mbot" or factor == 0.0 else "dsp3000",
        ticks=ticks,
        person=Person(
            wheel_radius=robot["wheel_radius"] * (1.0 + 0.005 * float(random.standard_normal())),
            base_width=robot["base_width"] * (1.0 + 0.02 * float(random.standard_normal())),
            ticks=round(stated * ticks),
            miscounts=0.1,
            has_gyro=factor != 0.0,
            measures_stop=bool(random.random() < 0.5),
        ),
        seed=int(random.integers(2**31)),
        offset=float(random.choice((math.pi / 2, math.pi, -math.pi / 2, 0.4))),
    )


MOUNTED = {"motors": 0.5, "left": 0.5, "right": 0.5, "encoders": 0.3, "left_against": 0.1, "right_against": 0.1} | {
    "left_dead": 0.06,
    "right_dead": 0.06,
}


def _cameras(right: Cameras, wrong: tuple[str, ...], offset: float) -> Cameras:
    """Return cameras with these faults; a rotated heading is off by `offset` [rad]."""
    return dataclasses.replace(
        right,
        mirrored="mirrored" in wrong,
        heading_offset=offset if "rotated" in wrong else 0.0,
        vertical_y="y up" in wrong,
        metre=1000.0 if "mm" in wrong else 1.0,
        radian=RADIAN if "degrees" in wrong else 1.0,
        other_body="other body" in wrong,
    )


def mounting_of(flags: Mapping[str, bool], factor: float) -> Mounting:
    """Return the emulator's mounting for the faults named in MOUNTED; `factor` scales the gyro's yaw rate."""
    return Mounting(
        motors_swapped=flags["motors"],
        encoders_swapped=flags["encoders"],
        left_motor_inverted=flags["left"],
        right_motor_inverted=flags["right"],
        left_encoder_inverted=flags["left"] is not flags["left_against"],
        right_encoder_inverted=flags["right"] is not flags["right_against"],
        left_encoder_dead=flags["left_dead"],
        right_encoder_dead=flags["right_dead"] and not flags["left_dead"],
        gyro_factor=factor,
    )


def _robot_with_effects(random: np.random.Generator) -> tuple[dict[str, float], dict[str, float]]:
    """Return a random robot and the sizes of six small effects, drawn as in scripts/study_messy."""
    from tests.hidden_effects.messy import ORDINARY, SPREAD
    from tests.hidden_effects.robots import draw_robot, scales
    from tests.hidden_effects.sizes import EITHER_SIGN, GROWS_WITH

    robot = draw_robot(random)
    grown = scales(robot)
    effects = {
        str(name): float(
            (random.choice((-1.0, 1.0)) if name in EITHER_SIGN else 1.0)
            * ORDINARY[str(name)]
            * random.uniform(1.0 - SPREAD, 1.0 + SPREAD)
            * grown[GROWS_WITH.get(str(name), "-")]
        )
        for name in random.choice(list(ORDINARY), EFFECTS_AT_ONCE, replace=False)
    }
    return dict(robot), effects


def case_of(
    name: str,
    *,
    robot: Mapping[str, float],
    effects: Mapping[str, float],
    mounting: Mounting,
    wrong: tuple[str, ...],
    controller: str,
    gyro: str | None,
    ticks: int,
    person: Person,
    seed: int,
    offset: float,
) -> Case:
    """Return a robot with these effects and faults; the heading of `rotated` poses is off by `offset` [rad]."""
    settings = load_settings(seed=seed)
    hidden = dict(effects)
    if "offset" in wrong:
        hidden["pose_offset"] = 0.05
    if "late" in wrong:
        hidden["pose_latency"] = 0.3
    body = {key: robot[key] for key in ("wheel_radius", "k2_over_k3", "k1", "base_width")}
    quantisation = dataclasses.replace(settings.imperfections.encoder_quantisation, ticks_per_turn=float(ticks))
    settings = dataclasses.replace(
        settings,
        robot=dataclasses.replace(settings.robot, **body, ticks_per_turn=float(ticks)),
        mounting=mounting,
        cameras=_cameras(settings.cameras, wrong, offset),
        imperfections=dataclasses.replace(settings.imperfections, encoder_quantisation=quantisation),
        effects=hidden,
    )
    bringup = SimulatedBringup(settings, person, controller, gyro, own_number=1 if "swapped" in wrong else 0, seed=seed)
    return Case(name, wrong, bringup)


def verdict(case: Case, outcome: Outcome) -> tuple[str, list[str]]:
    """Return "right", "unknown" or "wrong", and the wrong settings or the reasons of undecided steps."""
    wrong = [*_wrong_wiring(case, outcome), *_wrong_gyro(case, outcome), *_wrong_poses(case, outcome)]
    if outcome.largest_before_yes > 0.1 or outcome.largest_before_floor > 0.2:
        wrong.append(f"duty {outcome.largest_before_yes:.4f}, {outcome.largest_before_floor:.4f}")
    if wrong:
        return "wrong", wrong
    open_steps = [f"{result.step}: {result.text}" for result in outcome.results if not result.decided]
    surprising = [text for text in open_steps if not _expected(case, text)]
    if outcome.of("floor").decided and outcome.known.found["poses_unsure_lateness"]:
        surprising.append(outcome.of("floor").text)
    return ("unknown", surprising) if surprising else ("right", open_steps)


def _expected(case: Case, text: str) -> bool:
    """Return whether a step is undecided because of a fault of the robot, and its text names that fault."""
    mounting = case.settings.mounting
    if text.startswith("floor"):
        if mounting.left_encoder_dead or mounting.right_encoder_dead:
            return "never counts" in text
        if "other body" in case.wrong:
            return "do not move as this robot does" in text
        if "swapped" in case.wrong:
            return "bodies are swapped" in text
    return False


def _wrong_wiring(case: Case, outcome: Outcome) -> list[str]:
    known, mounting = outcome.known, case.settings.mounting
    if "motors" in known.undecided:
        return []
    dead = [side for side in ("left", "right") if getattr(mounting, f"{side}_encoder_dead")]
    truth: dict[str, object] = {
        "swap": mounting.motors_swapped,
        "swap_encoders": mounting.encoders_swapped,
        "invert_left": mounting.left_motor_inverted,
        "invert_right": mounting.right_motor_inverted,
    }
    for side in {"left", "right"} - set(dead):
        against = getattr(mounting, f"{side}_motor_inverted") is not getattr(mounting, f"{side}_encoder_inverted")
        truth[f"invert_{side}_encoder"] = against
    wrong = [f"{name} {known.driver.get(name)}" for name, value in truth.items() if known.driver.get(name) != value]
    if known.found.get("dead_encoders") != dead:
        wrong.append(f"dead {known.found.get('dead_encoders')}")
    ticks = known.driver.get("ticks_per_turn")
    if "ticks" not in known.undecided:
        true = case.settings.robot.ticks_per_turn
        if not isinstance(ticks, int) or abs(ticks / true - 1.0) > TICKS_TOLERANCE:
            wrong.append(f"ticks {ticks} of {true:.0f}")
    return wrong


def _wrong_gyro(case: Case, outcome: Outcome) -> list[str]:
    known, factor = outcome.known, case.settings.mounting.gyro_factor
    if "gyro" in known.undecided:
        return []
    present = case.bringup.person.has_gyro
    if known.found.get("gyro") is not present:
        return ["gyro presence"]
    if not present:
        return []
    wrong = [] if known.driver.get("invert_gyro") is (factor < 0.0) else ["invert_gyro"]
    return wrong if known.found.get("gyro_scale") == abs(factor) else [*wrong, "gyro_scale"]


def _wrong_poses(case: Case, outcome: Outcome) -> list[str]:
    if not outcome.of("floor").decided:
        return []
    found, cameras, wrong = outcome.known.found, case.settings.cameras, []
    if found["poses_vertical"] != ("y" if cameras.vertical_y else "z"):
        return [f"vertical {found['poses_vertical']}"]
    if cameras.vertical_y:
        return []
    if cameras.other_body or case.bringup.own_number:
        return ["poses of another body accepted"]
    if found["poses_metre"] != cameras.metre:
        wrong.append(f"metre {found['poses_metre']}")
    if found["poses_degrees"] is not (cameras.radian != 1.0):
        wrong.append("degrees")
    if found["poses_mirrored"] is not cameras.mirrored:
        wrong.append("mirrored")
    number = outcome.known.number
    if abs(math.remainder(number("poses_heading_offset") - cameras.heading_offset, 2.0 * math.pi)) > ANGLE:
        wrong.append(f"heading offset {number('poses_heading_offset'):.3f}")
    hidden = case.settings.effects
    point = complex(number("poses_ahead"), number("poses_left")) - hidden.get("pose_offset", 0.0)
    if abs(point) > POINT:
        wrong.append(f"point {number('poses_ahead'):.3f} {number('poses_left'):.3f}")
    late = number("poses_lateness") - hidden.get("pose_latency", 0.0)
    if abs(late) > LATENESS and not found["poses_unsure_lateness"]:
        wrong.append(f"lateness {number('poses_lateness'):.3f}")
    return wrong
