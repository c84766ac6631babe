"""The physics of real robots in a team: motors, friction, wheels on the ground, in steps of 1 ms, compiled.

It shares no code with `cmr.model`, whose judge it is: another integrator, friction with reversals, slip, noise. The
laws are those of `cmr.plant`, which keeps the time of one robot and is too slow for many; a test holds the two against
each other. Only the battery differs: here the load shrinks with the voltage.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cmr.team.hidden import HiddenRobot, columns

Floats = NDArray[np.float64]
STEP = 0.001  # s
RING = 256  # steps; more than the longest command delay
STATIC_FADE = 0.5  # rad/s; the speed at which static friction has fallen to a third and the ground is felt fully
NORMALS = 4  # random numbers a step and robot: torque and slip of both sides


class Laws(NamedTuple):
    """What moves each robot: arrays of shape (n,), or (2, n) with the left side first; units as in HiddenRobot."""

    gain: Floats
    damping: Floats
    k1: Floats
    radius: Floats
    base_width: Floats
    coulomb: Floats
    static: Floats
    sag: Floats
    turn_slip: Floats
    slip: Floats
    slip_noise: Floats
    torque_noise: Floats
    kept_torque: Floats
    delay: NDArray[np.int64]


class State(NamedTuple):
    """How the robots are: pose (3, n) [m, m, rad], and angle [rad], velocity [rad/s] and torque [rad/s^2], (2, n)."""

    pose: Floats
    angle: Floats
    velocity: Floats
    torque: Floats


class Plant:
    """Real robots, `steps` of 1 ms after the start; each has random numbers of its own, fixed by its seed.

    `state` is how they really are; headings are never wrapped.
    """

    def __init__(self, robots: Sequence[HiddenRobot], poses: Floats, seeds: Sequence[Sequence[int]]) -> None:
        """Put robots at rest at `poses`, shape (3, n)."""
        numbers = columns(robots)
        still = np.zeros((2, len(robots)))
        self.steps = 0
        self._ticks_per_turn = numbers["ticks_per_turn"]
        self._laws = _laws(numbers)
        self._random = [np.random.default_rng(seed) for seed in seeds]
        torque = numbers["torque_noise"] * np.array([random.standard_normal(2) for random in self._random]).T
        self.state = State(np.array(poses, dtype=float), still.copy(), still.copy(), np.ascontiguousarray(torque))
        self._duty = still.copy()
        self._ring = np.zeros((RING, 2, len(robots)))

    def command(self, duty: Any) -> None:
        """Drive with these duties, shape (2, n), -1 to 1, from now on; each robot later by its command delay."""
        self._duty = np.clip(np.array(duty, dtype=float), -1.0, 1.0)

    def advance(self, steps: int) -> None:
        """Let so many steps pass."""
        normals = np.stack([random.standard_normal((steps, NORMALS)) for random in self._random], axis=2)
        _advance(self.steps, self.state, self._laws, self._duty, self._ring, normals)
        self.steps += steps

    def ticks(self) -> Floats:
        """Return what the encoders have counted since the start: whole numbers, shape (2, n)."""
        return np.floor(self.state.angle / (2.0 * math.pi) * self._ticks_per_turn)


def _laws(numbers: dict[str, Floats]) -> Laws:
    sides = np.array([[0.5], [-0.5]])
    return Laws(
        gain=numbers["k2_over_k3"] * (1.0 + sides * numbers["motor_asymmetry"]),
        damping=numbers["k1"] * numbers["k2_over_k3"],
        k1=numbers["k1"],
        radius=numbers["wheel_radius"] * (1.0 + sides * numbers["radius_asymmetry"]),
        base_width=numbers["base_width"],
        coulomb=numbers["coulomb_friction"],
        static=numbers["static_friction"],
        sag=numbers["battery_sag"],
        turn_slip=numbers["turn_slip"],
        slip=numbers["longitudinal_slip"],
        slip_noise=numbers["slip_noise"],
        torque_noise=numbers["torque_noise"],
        kept_torque=np.exp(-STEP / numbers["torque_noise_time"]),
        delay=np.rint(numbers["command_delay"] / STEP).astype(np.int64),
    )


@njit(cache=True)
def _advance(first: int, state: State, laws: Laws, duty: Floats, ring: Floats, normals: Floats) -> None:
    """Let len(normals) steps pass from step number `first` on; `ring` holds the duties of the last RING steps."""
    for k in range(len(normals)):
        now = (first + k) % RING
        ring[now] = duty
        for i in range(state.pose.shape[1]):
            then = (first + k - laws.delay[i]) % RING
            left, right = ring[then, 0, i], ring[then, 1, i]
            supply = _supply(left, right, state.velocity[0, i], state.velocity[1, i], laws.k1[i], laws.sag[i])
            way_left = _way(0, i, state, laws, supply * left, normals[k, 0, i], normals[k, 1, i])
            way_right = _way(1, i, state, laws, supply * right, normals[k, 2, i], normals[k, 3, i])
            turn = (way_right - way_left) / laws.base_width[i]
            # Base width b (1 + k abs(w)): w (1 + k abs(w)) = w_0, solved for w so that nothing happens at k = 0.
            turn *= 2.0 / (1.0 + math.sqrt(1.0 + 4.0 * laws.turn_slip[i] * abs(turn) / STEP))
            way, heading = 0.5 * (way_left + way_right), state.pose[2, i] + 0.5 * turn
            state.pose[0, i] += way * math.cos(heading)
            state.pose[1, i] += way * math.sin(heading)
            state.pose[2, i] += turn


@njit(cache=True)
def _supply(left: float, right: float, velocity_left: float, velocity_right: float, k1: float, sag: float) -> float:
    """Return the voltage that the battery holds under load, as a share of that without.

    A chopper draws duty times the motor's current, u (s u - k1 psi) of the stall current; with source resistance R
    that gives s = 1 - R sum(u (s u - k1 psi)), solved here for s.
    """
    induced = k1 * (left * velocity_left + right * velocity_right)
    return min(1.0, (1.0 + sag * induced) / (1.0 + sag * (left * left + right * right)))


@njit(cache=True)
def _way(side: int, i: int, state: State, laws: Laws, voltage: float, torque: float, slip: float) -> float:
    """Turn a wheel for a step; return the way [m] that it pulls its side of the robot. The last two are normal."""
    before = state.velocity[side, i]
    kept = laws.kept_torque[i]
    state.torque[side, i] *= kept
    state.torque[side, i] += laws.torque_noise[i] * math.sqrt(1.0 - kept * kept) * torque
    # Uneven gears and ground are felt by a wheel that turns; they do not set off one that rests.
    drive = laws.gain[side, i] * voltage + min(1.0, abs(before) / STATIC_FADE) * state.torque[side, i]
    after, turned = _turned(before, drive, laws.damping[i], laws.coulomb[i], laws.static[i])
    state.velocity[side, i] = after
    state.angle[side, i] += turned
    way = laws.radius[side, i] * (turned - laws.slip[i] * (after - before))
    return float(way + laws.slip_noise[i] * math.sqrt(abs(way)) * slip)


@njit(cache=True)
def _turned(before: float, drive: float, damping: float, coulomb: float, static: float) -> tuple[float, float]:
    """Return velocity [rad/s] and angle turned [rad] after a step, by Heun's method; friction may stop the wheel."""
    if before == 0.0 and abs(drive) <= coulomb + static:
        return 0.0, 0.0
    direction = math.copysign(1.0, before if before != 0.0 else drive)
    slope = drive - damping * before - direction * (coulomb + static * math.exp(-((before / STATIC_FADE) ** 2)))
    ahead = before + STEP * slope
    slope_ahead = drive - damping * ahead - direction * (coulomb + static * math.exp(-((ahead / STATIC_FADE) ** 2)))
    after = before + 0.5 * STEP * (slope + slope_ahead)
    if after * direction < 0.0 and coulomb + static > 0.0:
        # Friction changes sign with the motion: the wheel stops at the reversal, and the next step sees it at rest.
        return 0.0, 0.5 * before * STEP * before / (before - after)
    return after, 0.5 * STEP * (before + after)
