"""Diagnoses made by hand, one of each verdict, of a robot whose tracked point is off centre and whose wheels differ."""

import math
from dataclasses import replace

import numpy as np

from cmr.diagnosis.result import (
    BAD_DATA,
    EFFECTS_FOUND,
    LAW_FOUND,
    NO_EFFECT,
    PARAMETERS_DIFFER,
    UNEXPLAINED,
    Against,
    Candidate,
    Departure,
    Diagnosis,
    Evidence,
    Fitted,
    NamedEffect,
    Path,
    Residual,
)
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.estimation.laws.result import LAW, LawFound, Laws
from cmr.estimation.unexplained.result import Unexplained
from cmr.model.laws import Law
from cmr.recordings.faults.findings import Finding
from cmr.recordings.signal import Floats

OFFSET, ASYMMETRY = 0.144, 0.05  # m; share
SECONDS, RATE = 60.0, 50.0  # s, Hz
UNITS = {"psi_left": "rad/s", "psi_right": "rad/s", "yaw_rate": "rad/s", "forward": "m", "sideways": "m"}


class Motion:
    """A drive of figure-eights at changing speed, all arrays of shape (n,)."""

    def __init__(self) -> None:
        self.time = np.arange(0.0, SECONDS, 1.0 / RATE)
        self.speed = 0.3 + 0.15 * np.sin(0.23 * self.time)
        self.yaw_rate = 1.1 * np.sin(0.8 * self.time) * self.speed / 0.3
        self.theta = np.cumsum(self.yaw_rate) / RATE
        self.x = np.cumsum(self.speed * np.cos(self.theta)) / RATE
        self.y = np.cumsum(self.speed * np.sin(self.theta)) / RATE

    @property
    def regressors(self) -> dict[str, Floats]:
        left, right = (self.speed + side * 0.08 * self.yaw_rate for side in (-1.0, 1.0))
        return {
            "time": self.time,
            "command_left": left / 0.72,
            "command_right": right / 0.72,
            "speed": self.speed,
            "yaw_rate": self.yaw_rate,
            "speed_times_yaw_rate": self.speed * self.yaw_rate,
            "x": self.x,
            "y": self.y,
            "heading": self.theta,
            "wheel_angle_left": np.cumsum(left) / RATE / 0.04,
            "wheel_angle_right": np.cumsum(right) / RATE / 0.04,
            "energy": 0.08 * self.time,
        }


MOTION = Motion()


def noise(seed: int, size: float) -> Floats:
    """Noise that lasts some tenths of a second."""
    white = np.random.default_rng(seed).normal(size=len(MOTION.time) + 20)
    return size * np.convolve(white, np.ones(21) / math.sqrt(21.0), "valid")


def residual(signal: str, seed: int, size: float, structure: Floats | float = 0.0, effect: str = "") -> Residual:
    """The residual of a signal that has this structure before, and without the effect that makes it; none after."""
    after = noise(seed, size)
    effects = ("pose_offset", "wheel_radius_asymmetry")
    return Residual(
        signal=signal,
        unit=UNITS.get(signal, "rad"),
        before=after + structure,
        after=after,
        regressors=MOTION.regressors,
        without={name: after + structure if name == effect else after for name in effects},
    )


def residuals() -> tuple[Residual, ...]:
    """What a robot leaves whose tracked point sits ahead of its centre and whose wheels differ."""
    turned = MOTION.yaw_rate * 1.0  # rad in the second over which errors of the pose grow
    return (
        residual("psi_left", 1, 0.2),
        residual("psi_right", 2, 0.2),
        residual("yaw_rate", 3, 0.02, 0.5 * ASYMMETRY * MOTION.speed / 0.08, "wheel_radius_asymmetry"),
        residual("forward", 4, 0.006, OFFSET * (np.cos(turned) - 1.0), "pose_offset"),
        residual("sideways", 5, 0.006, OFFSET * np.sin(turned), "pose_offset"),
        residual("heading", 6, 0.004),
    )


def path(label: str = "run.lcm") -> Path:
    m = MOTION
    seen_x, seen_y = m.x + OFFSET * np.cos(m.theta), m.y + OFFSET * np.sin(m.theta)
    drift = 0.004 * m.time
    return Path(
        label=label,
        time=m.time,
        x=seen_x,
        y=seen_y,
        theta=m.theta,
        before_x=m.x + OFFSET + drift,
        before_y=m.y - drift,
        before_theta=m.theta + 0.01 * m.time,
        after_x=seen_x + 0.03 * drift,
        after_y=seen_y - 0.05 * drift,
        after_theta=m.theta,
    )


BASELINE = Fitted(
    estimates={
        "k2_over_k3": Estimate(118.0, 0.8),
        "k1": Estimate(0.0540, 0.0002),
        "base_width": Estimate(0.182, 0.0011),
    },
    path_rmse=0.104,
    held_out_path_rmse=0.110,
)
EXTENDED = Fitted(
    estimates={
        "k2_over_k3": Estimate(117.6, 0.7),
        "k1": Estimate(0.0541, 0.0002),
        "base_width": Estimate(0.161, 0.0006),
        "pose_offset": Estimate(0.1443, 0.0021),
        "wheel_radius_asymmetry": Estimate(0.0512, 0.0009),
    },
    path_rmse=0.035,
    held_out_path_rmse=0.037,
)
EFFECTS = (
    NamedEffect(
        name="pose_offset",
        cause="The tracked point sits 0.144 m ahead of the centre of rotation.",
        estimates={"pose_offset": EXTENDED.estimates["pose_offset"]},
        statistic=3110.4,
        p_value=0.0,
        held_out=1204.0,
        shift={"base_width": -0.0205, "k1": 0.00002},
        indistinguishable_from=("lateral_skid",),
        next_experiment="Spin on the spot at three rates: `cmr-sim --virtual 10=figure_eight,size=0.2 --parameters .`",
    ),
    NamedEffect(
        name="wheel_radius_asymmetry",
        cause="The left wheel is the larger one: each is 5.12 % off the mean.",
        estimates={"wheel_radius_asymmetry": EXTENDED.estimates["wheel_radius_asymmetry"]},
        statistic=311.0,
        p_value=2.4e-62,
        held_out=88.2,
        shift={"base_width": -0.0005},
    ),
)
CANDIDATES = (
    Candidate(
        name="turn_slip",
        statistic=31.2,
        p_value=2e-6,
        held_out=-14.3,
        why_not="It makes data worse that it was not fitted on.",
    ),
    Candidate(name="gyro_bias", statistic=1.3, p_value=1.0, held_out=0.2, why_not="Chance alone would give as much."),
)
CHECKS = (
    Finding("pose_jumps", 2, "The tracker jumps 2 times: the path is cut there and starts again."),
    Finding("gaps", 0, "Gaps in the data: none; the longest is 0.00 s."),
    Finding("encoder_spikes", 0, "0 absurd encoder readings: set aside."),
)
FOUND = Diagnosis(
    robot_id=0,
    verdict=EFFECTS_FOUND,
    sentence="The tracked point sits 0.144 m ahead of the centre of rotation, and the left wheel is 5.1 % larger than "
    "the mean; with both, the simulated robot strays 3 times less.",
    baseline=BASELINE,
    extended=EXTENDED,
    effects=EFFECTS,
    candidates=CANDIDATES,
    gain=Gain(ratio=2.97, interval=(2.61, 3.30), signals={"psi": 1.0, "yaw_rate": 4.2, "pose": 2.97}),
    checks=CHECKS,
    notes=("A shifted centre of rotation and a tracked point off centre are the same mathematics.",),
    parameters={"wheel_radius": 0.04, **{name: e.value for name, e in EXTENDED.estimates.items()}},
    evidence=Evidence(window=3.0, paths=(path(),), residuals=residuals()),
    sources=("husky/tile_01.lcm", "husky/tile_02.lcm"),
    samples=9120,
)
UNCHANGED = Evidence(
    window=3.0,
    paths=(replace(path(), after_x=path().before_x, after_y=path().before_y, after_theta=path().before_theta),),
    residuals=tuple(replace(r, before=r.after, without={}) for r in residuals()),
)
NOTHING = replace(
    FOUND,
    verdict=NO_EFFECT,
    sentence="The paper's model explains these data; no effect of the catalogue shows in them.",
    extended=BASELINE,
    effects=(),
    gain=None,
    notes=(),
    next_experiment="Drive big steps and reversals; a figure-eight does not show battery_sag or saturation.",
    parameters={"wheel_radius": 0.04, **{name: e.value for name, e in BASELINE.estimates.items()}},
    evidence=UNCHANGED,
)
STRANGE = replace(
    NOTHING,
    verdict=UNEXPLAINED,
    sentence="The yaw rate follows the speed in a way that no effect of the catalogue explains.",
    unexplained=Unexplained(present=True, signal="yaw_rate", regressors=("speed", "time"), share=0.34),
    evidence=replace(UNCHANGED, residuals=tuple(replace(r, after=r.before, without={}) for r in residuals())),
)
SPOILT = Diagnosis(
    robot_id=3,
    verdict=BAD_DATA,
    sentence="The robot never moves in this recording: nothing can be diagnosed.",
    checks=(Finding("never_moved", 1, "The robot never moves in this recording."), *CHECKS[1:]),
    notes=("Its gyro says nothing but zero.",),
    next_experiment="Check that the motors are switched on, and record a drive of at least 30 s.",
    sources=("run.lcm",),
)
DEPARTED = replace(
    NOTHING,
    verdict=PARAMETERS_DIFFER,
    sentence="The robot departs from robot_3.yaml (sha256 0123456789ab). base_width is 0.172 m, in the file 0.161.",
    extended=EXTENDED,
    against=Against(
        source="robots/robot_3.yaml",
        sha256="0123456789ab" + 52 * "0",
        departures=(Departure(name="base_width", given=0.161, estimate=BASELINE.estimates["base_width"]),),
    ),
)
LAWFUL = replace(
    NOTHING,
    verdict=LAW_FOUND,
    sentence="Speed costs turning: w = w_wheels (1 - 0.061 s/m abs(v)), -0.061 +- 0.002 s/m.",
    laws=Laws(
        answer=LAW,
        found=(
            LawFound(
                law=Law("law_turn_cost", "yaw_rate", ("w * abs(v)",)),
                estimates={"law_turn_cost": Estimate(-0.061, 0.002)},
                gain=Gain(ratio=3.4, interval=(3.0, 4.0), signals={"pose": 3.4}),
                held_out=210.0,
                score=1800.0,
                left=4.0,
            ),
        ),
        reasons=("It lowers -2 log likelihood by 1810 on the fitted data.",),
    ),
)
ALL = {
    EFFECTS_FOUND: FOUND,
    LAW_FOUND: LAWFUL,
    NO_EFFECT: NOTHING,
    UNEXPLAINED: STRANGE,
    BAD_DATA: SPOILT,
    PARAMETERS_DIFFER: DEPARTED,
}
