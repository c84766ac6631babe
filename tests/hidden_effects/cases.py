"""What is hidden in a log: the case that asks for it, and the truth that came of it."""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tests.hidden_effects.laws.kinds import KINDS
from tests.hidden_effects.unknown import FRICTIONS, UNKNOWN
from tests.reference_plant import REALISTIC, TYPICAL, Noise
from tests.reference_plant.manoeuvres import HELD_OUT_SECONDS, PART_SECONDS, RICH_DRIVE_SECONDS

RICH, EIGHT, EIGHT_OPEN = "rich", "figure_eight", "figure_eight_open"
# What is recorded of these are windows: of the rich drive, and of a robot with a velocity controller.
WINDOWS, CONTROLLED_WINDOWS = "windows", "controlled_windows"
SECONDS: dict[str, float] = {
    RICH: RICH_DRIVE_SECONDS,
    EIGHT: 120.0,
    EIGHT_OPEN: 120.0,
    WINDOWS: RICH_DRIVE_SECONDS,
    CONTROLLED_WINDOWS: 120.0,
}
BEGINNING = "beginning_of_rich"
# Short drives in which the robot turns: the beginning of the rich drive, and parts of it by themselves.
SHORT_SECONDS: dict[str, float] = {
    BEGINNING: 60.0,
    **{name: seconds for name, seconds in PART_SECONDS.items() if name != "straight_runs"},
}
HELD_OUT = "held_out"  # other parts than those of the rich drive, at other speeds and radii
BRIEF, BRIEF_SECONDS = "short_drive", 55.0  # that of cmr.geometry, and its rest; s for slow robots, too
OTHER_SECONDS: dict[str, float] = {**SHORT_SECONDS, HELD_OUT: HELD_OUT_SECONDS, BRIEF: BRIEF_SECONDS}
WALK = 0.02  # share of a gyro's drift over 100 s by which it walks at random in that time


def louder(noise: Noise, times: float) -> Noise:
    """Return noise that many times as large, seen with the same encoders."""
    sizes = ("torque", "slip", "gyro", "position", "heading")
    return replace(noise, **{name: times * getattr(noise, name) for name in sizes})


# How noisy robots are. Poses of `white` err again each time, those of `slow` err for half a second in the same way;
# encoders of `coarse` have few ticks.
NOISES: Mapping[str, Noise] = {
    "realistic": REALISTIC,
    "white": replace(REALISTIC, pose_time=0.0),
    "slow": replace(REALISTIC, pose_time=0.5),
    "threefold": louder(REALISTIC, 3.0),
    "threefold_white": replace(louder(REALISTIC, 3.0), pose_time=0.0),
    "threefold_slow": replace(louder(REALISTIC, 3.0), pose_time=0.5),
    "coarse": replace(REALISTIC, ticks_per_turn=48.0),
}


@dataclass(frozen=True)
class Case:
    """What to hide, and how the robot is driven and seen.

    `effects` are names of reference_plant.TYPICAL, of UNKNOWN, or of KINDS. `seed` draws the robot, the size of the
    effects, and the drive; `run` numbers drives of the same robot with the same effects. `noise` is a name of NOISES,
    `friction` of FRICTIONS; the drive is made `repeats` times. Raises ValueError for a name that is not known.
    """

    effects: tuple[str, ...] = ()
    manoeuvre: str = RICH
    seed: int = 0
    noise: str = "realistic"
    friction: str = "dry"
    run: int = 0
    repeats: int = 1

    def __post_init__(self) -> None:
        known = {"manoeuvre": {**SECONDS, **OTHER_SECONDS}, "noise": NOISES, "friction": FRICTIONS}
        asked = [(kind, getattr(self, kind), names) for kind, names in known.items()]
        asked += [("effect", effect, {**TYPICAL, **UNKNOWN, **KINDS}) for effect in self.effects]
        for kind, name, names in asked:
            if name not in names:
                raise ValueError(f"no {kind} {name!r}; there are {', '.join(names)}")

    @property
    def seconds(self) -> float:
        """How long the drive takes."""
        return self.repeats * (SECONDS | OTHER_SECONDS)[self.manoeuvre]

    @property
    def drive_seed(self) -> int:
        """What all noise in this drive is drawn from."""
        return int(self.random("noise", self.run).integers(2**31))

    def random(self, purpose: str, *further: int) -> np.random.Generator:
        """Return what draws one thing; whatever else is drawn, the same case draws the same here."""
        names = "+".join((purpose, *sorted(self.effects)))
        return np.random.default_rng([self.seed, zlib.crc32(names.encode()), *further])


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What is hidden in a log.

    `robot` are the paper's four parameters, `parameters` those of what is hidden, those of effects in the catalogue's
    units; `nominal` is what the log announces of the robot.
    """

    case: Case
    robot: Mapping[str, float]
    parameters: Mapping[str, float]
    nominal: Mapping[str, float]

    @property
    def effects(self) -> tuple[str, ...]:
        """The names of the hidden effects."""
        return tuple(name for name in self.case.effects if name in TYPICAL)

    @property
    def unknown(self) -> tuple[str, ...]:
        """The names of hidden physics that no effect describes."""
        return tuple(name for name in self.case.effects if name in {**UNKNOWN, **KINDS})

    @property
    def noise(self) -> Noise:
        """How noisy the robot is; a gyro that drifts does so a little unevenly."""
        uneven = WALK * abs(self.parameters.get("gyro_drift", 0.0)) / math.sqrt(100.0)
        return replace(NOISES[self.case.noise], gyro_walk=uneven)

    @property
    def plant(self) -> dict[str, float]:
        """All that the plant needs to know."""
        return {**self.robot, **self.parameters, **FRICTIONS[self.case.friction]}
