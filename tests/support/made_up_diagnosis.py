"""A diagnosis with something in every field, numbers that are not finite among them; and one of bad data."""

import math

import numpy as np

from cmr.diagnosis.result import BAD_DATA, EFFECTS_FOUND, Candidate, Diagnosis, Fitted, NamedEffect
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.estimation.search.trace import ADDED, REJECTED, REMOVED, REPLACED, Decision, Measure
from cmr.estimation.unexplained.result import Unexplained
from cmr.recordings.faults.findings import Finding
from cmr.recordings.lateness import Lateness

BASELINE = {"k2_over_k3": Estimate(118.0, 0.8), "k1": Estimate(0.054, 2e-4), "base_width": Estimate(0.172, 6e-4)}
REFITTED = {**BASELINE, "base_width": Estimate(0.161, 5e-4)}
FRICTION = {"coulomb_friction": Estimate(4.1, 0.1)}
SURFACE = {
    "surface_change_k1": Estimate(0.05, 0.004),
    "surface_change_base_width": Estimate(0.04, math.inf),
    "surface_change_time": Estimate(61.0, 0.3),
}
SOUND = Finding("pose_jumps", 0, "The tracker jumps 0 times.")
FAULT = Finding("pose_outliers", 3, "3 poses cannot be true: set aside.", {"poses": np.ones(3, np.bool_)})
TOO_SMALL = Measure(
    "gyro_bias", 0.0018, 0.003, "rad/s", "Its size, 0.0018 rad/s, is below what matters here, 0.0030 rad/s."
)
DIAGNOSIS = Diagnosis(
    robot_id=4,
    verdict=EFFECTS_FOUND,
    sentence="Friction slows both wheels, and the floor changes.",
    baseline=Fitted(estimates=BASELINE, path_rmse=0.081, held_out_path_rmse=0.093),
    extended=Fitted(estimates={**REFITTED, **FRICTION, **SURFACE}, path_rmse=0.012, held_out_path_rmse=0.0141234567),
    effects=(
        NamedEffect(
            name="coulomb_friction",
            cause="Dry friction slows both wheels by 4.1 rad/s^2.",
            estimates=FRICTION,
            statistic=311.0,
            p_value=1e-60,
            held_out=50.5,
            shift={"base_width": -0.011, "k1": math.nan},
            indistinguishable_from=("quadratic_drag",),
            next_experiment="Drive straight at two speeds.",
        ),
        NamedEffect(
            name="surface_change",
            cause="The floor changes at 61.0 s.",
            estimates=SURFACE,
            statistic=40.0,
            p_value=1e-6,
        ),
    ),
    candidates=(
        Candidate(name="slope", statistic=2.0, p_value=0.8, held_out=-1.0, why_not="Other data speak against it."),
        Candidate(
            name="gyro_bias",
            statistic=62.2,
            p_value=1e-9,
            held_out=30.5,
            why_not=TOO_SMALL.sentence,
            estimates={"gyro_bias": Estimate(0.0018, 0.0002)},
            harmless=True,
            measure=TOO_SMALL,
        ),
    ),
    gain=Gain(ratio=6.6, interval=(5.9, math.inf), signals={"psi": 1.0, "pose": 6.6, "yaw_rate": math.nan}),
    unexplained=Unexplained(present=True, signal="yaw_rate", regressors=("speed",), share=0.2),
    checks=(SOUND, FAULT),
    notes=("The drive was short.",),
    next_experiment="Drive straight at two speeds.",
    parameters={
        "wheel_radius": 0.04,
        **{name: estimate.value for name, estimate in {**REFITTED, **FRICTION, **SURFACE}.items()},
        "gyro_bias": 0.0,
        "turn_rate_limit": math.inf,
    },
    sources=("circles.lcm", "squares.lcm"),
    samples=6000,
    lateness={"circles.lcm": Lateness(0.011, 0.0004, 0.006, 900, 0.002, 500)},
    decisions=(
        Decision(0, ADDED, ("slope",), 40.2, 30.0, "It explains most."),
        Decision(
            1,
            REPLACED,
            ("coulomb_friction", "surface_change"),
            351.0,
            math.nan,
            "slope left for it, and nothing that "
            "anybody could drive with this robot would tell it apart from what came in its place.",
        ),
        Decision(2, REJECTED, ("gyro_bias",), 1.3, 44.7, "Its improvement of the fit may be chance."),
        Decision(2, REMOVED, ("slope",), -0.01, math.nan, "The others explain as much without it."),
        Decision(2, REMOVED, ("gyro_bias",), 62.2, math.nan, TOO_SMALL.sentence, (TOO_SMALL,)),
    ),
)
BAD = Diagnosis(robot_id=4, verdict=BAD_DATA, sentence="The robot never moved.", checks=(FAULT,))
