"""Predict movements: the robot's path by several explanations, and the change of its sensors by each effect.

A movement begins when the present one ends, so a prediction begins now and contains the rest of the present one. Paths
are free runs. For the sensors, the best explanation drives first and gives the readings; then each effect, at its usual
size, observes these readings with the judge's gains. The white innovations of an effect beyond those of the best
explanation are its column.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.estimation.candidates import lanes_of
from cmr.estimation.noise import Noise, foreign_sums, sums_of_past, whiten
from cmr.estimation.prediction import FREE, POSE_SIGNALS, Batch, Errors, Predictor
from cmr.estimation.search.cross_validation import GYRO
from cmr.estimation.segments import Segment
from cmr.investigation.movements import Movement, ramped
from cmr.investigation.resting import NoiseWithRests, resting
from cmr.model.catalogue import CATALOGUE
from cmr.model.commands import Commands
from cmr.model.duty_ramp import Limits
from cmr.model.effects.electronics import ENERGY_OF_A_DRIVE
from cmr.model.effects.motors import HEATING_TIME
from cmr.model.observer.drives import Drives, ends_of
from cmr.model.observer.observer import FOLLOWED, MOTION, RESTART, Gains, Observations, Observer
from cmr.model.observer.structures import Innovations
from cmr.recordings.signal import Floats

STEP = 0.01  # s
COASTING = 1.0  # s in which a robot without duty comes to rest
SETTLING = 0.4  # s before a movement, in which observers already follow the predicted readings
BETWEEN_PLACES = 0.05  # s, of a path
Values = Mapping[str, float]


@dataclass(frozen=True)
class Situation:
    """The robot's present state and pending commands; `limits` are those of its driver's duties.

    `state` is x, y, theta, psi_left, psi_right [m, rad, rad/s; world frame]; `time` [s] since the drive began; `turned`
    [rad] are the wheels' angles. `commands` are those not yet executed and the rest of the present movement, which ends
    in `busy` [s]; their times [s] count from now. `energy` [s] was drawn from the battery, `heat` is that of the
    motors, as the model's effects define them. `intervals` are the times [s] between readings of wheels, gyro and
    poses, None for a missing sensor.
    """

    state: tuple[float, float, float, float, float]
    time: float
    turned: tuple[float, float]
    commands: Commands
    busy: float
    energy: float
    heat: float
    limits: Limits
    intervals: tuple[float | None, float | None, float | None]


def carried_on(values: Values, situation: Situation) -> dict[str, float]:
    """Return the values of a robot that begins with the present charge and heat.

    The model begins with a full battery and cold motors. A battery that has lost the share s of its voltage equals a
    motor with k2_over_k3 (1 - s) and k1 / (1 - s); warm motors have a larger k1.
    """
    result = dict(values)
    lost = min(values.get("battery_drift", 0.0) * situation.energy / ENERGY_OF_A_DRIVE, 0.5)
    result["k2_over_k3"] = values["k2_over_k3"] * (1.0 - lost)
    warmer = 1.0 + values.get("motor_heating", 0.0) * situation.heat
    result["k1"] = values["k1"] / (1.0 - lost) * warmer
    return result


def effort(duty: Floats, psi: Floats, dt: float, k1: float, before: tuple[float, float]) -> tuple[float, float]:
    """Return the energy drawn from the battery [s of load share 1] and the motors' heat, by the model.

    Duties and wheel speeds [rad/s], (n, 2), are those of n steps of `dt` [s]; `before` are both at the start.
    """
    energy, heat = before
    energy += float(np.sum(np.maximum(0.0, duty * (duty - 0.8 * k1 * psi)))) * dt
    kept = np.exp(-dt / HEATING_TIME)
    squares = np.mean(duty**2, axis=1)
    weights = kept ** np.arange(len(squares))[::-1]
    return energy, heat * float(kept) ** len(squares) + float(np.sum((1.0 - kept) * weights * squares))


def advanced(situation: Situation, values: Values, seconds: float) -> Situation:
    """Return the situation of a robot with these values after `seconds` of the present movement."""
    steps = _steps(seconds)
    if steps <= 0:
        return situation
    none = np.empty(0)
    drive = _observations(situation, Movement("none", np.zeros((0, 2))), steps, none, none, none, seen_first=False)
    lanes = lanes_of([carried_on(_without_sensors(values), situation)])
    motion = Observer(lanes, FREE).observe(drive).motion
    psi = motion[:-1, [MOTION.index("psi_left"), MOTION.index("psi_right")]]
    energy, heat = effort(drive.duty, psi, STEP, values["k1"], (situation.energy, situation.heat))
    later = steps * STEP
    state = {name: float(motion[-1, MOTION.index(name)]) for name in MOTION}
    return replace(
        situation,
        state=(state["x"], state["y"], state["theta"], state["psi_left"], state["psi_right"]),
        time=situation.time + later,
        turned=(state["angle_left"], state["angle_right"]),
        commands=Commands(situation.commands.time - later, situation.commands.duty),
        busy=situation.busy - later,
        energy=energy,
        heat=heat,
    )


def paths(situation: Situation, movements: Sequence[Movement], ensemble: Sequence[Values]) -> list[Floats]:
    """Return the path of each movement, until the robot rests: x, y [m], theta, shape (places, members, 3) each.

    Places are BETWEEN_PLACES apart, the first one so long from now.
    """
    every = np.arange(BETWEEN_PLACES, 100.0, BETWEEN_PLACES)
    none = np.empty(0)
    drives = []
    for movement in movements:
        steps = _steps(situation.busy + movement.seconds + COASTING)
        time = every[every <= steps * STEP]
        drives.append(_observations(situation, movement, steps, none, none, time, seen_first=False))
    lanes = lanes_of([carried_on(_without_sensors(values), situation) for values in ensemble])
    lanes["wheel_radius"] = np.broadcast_to(lanes["wheel_radius"], len(ensemble)).copy()
    together = Drives.of(drives)
    innovations = Observer(lanes, FREE).observe_all(together)
    places = -innovations.pose.transpose(0, 2, 1)
    return np.split(places, together.recorded.ends.pose[1:-1])


def times_of(path: Floats) -> Floats:
    """Return the time of each place of a path [s from now]."""
    return np.arange(1.0, len(path) + 1.0) * BETWEEN_PLACES


def changes(
    situation: Situation,
    movements: Sequence[Movement],
    sets: Sequence[Values],
    gains: Gains,
    noise: Noise,
) -> list[Floats]:
    """Return the change of the white errors by other `sets` (s) of values than the first, (n, s - 1), by movement.

    Only errors after the present movement count: it is the same for all, and by its end the observer has followed an
    encoder of another scale.
    """
    situation = advanced(situation, sets[0], situation.busy - SETTLING)
    drives = []
    for movement in movements:
        steps = _steps(situation.busy + movement.seconds)
        times = (reading_times(interval, steps * STEP) for interval in situation.intervals)
        drives.append(_observations(situation, movement, steps, *times, seen_first=True))
    return changes_in(drives, [carried_on(values, situation) for values in sets], gains, noise, situation.busy)


def changes_in(
    drives: Sequence[Observations], lanes: Sequence[Values], gains: Gains, noise: Noise, since: float = 0.0
) -> list[Floats]:
    """Return the change of the white errors by other `lanes` (s) of values than the first, (n, s - 1), by drive.

    Of the `drives` only inputs and the times of readings count: the first lane gives the readings. Errors count from
    `since` [s] on.
    """
    free = Observer(lanes_of(lanes[:1]), FREE)
    read = [_read(one, free.observe(_unseen(one))) for one in drives]
    predictors = [Predictor(_segment(one, number)) for number, one in enumerate(read)]
    batch = Batch(predictors)
    errors = batch.errors(Observer(lanes_of(lanes), gains))
    for every in errors.of.values():
        every -= every[:, :1].copy()
    return [one[:, 1:] for one in _white(batch, errors, noise, since)]


def _steps(seconds: float) -> int:
    return int(np.ceil(seconds / STEP - 1e-9))


def _without_sensors(values: Values) -> dict[str, float]:
    """Return the values without the effects of sensors: a path is the robot's true one, not the measured one."""
    sensors = {p.name for effect in CATALOGUE.values() if effect.is_sensor for p in effect.parameters}
    return {name: value for name, value in values.items() if name not in sensors}


def reading_times(interval: float | None, seconds: float) -> Floats:
    """Return the times [s] of a sensor read every `interval` [s], None if it is missing."""
    return np.empty(0) if interval is None else np.arange(interval, seconds + 1e-9, interval)


def _observations(
    situation: Situation,
    movement: Movement,
    steps: int,
    wheel: Floats,
    gyro: Floats,
    pose: Floats,
    *,
    seen_first: bool,
) -> Observations:
    """Return a drive with this movement, in which all sensors read 0; with `seen_first` it begins at a pose."""
    commands = _commands(situation, movement)
    empty = np.empty(0)
    still = Observations(
        dt=STEP,
        steps=steps,
        commands=commands,
        start=situation.state,
        wheel_time=empty,
        wheel=np.empty((0, 2)),
        wheel_use=np.empty((0, 2), np.uint8),
        gyro_time=empty,
        gyro=empty,
        pose_time=empty,
        pose=np.empty((0, 3)),
        pose_use=np.empty(0, np.uint8),
        time=situation.time,
        turned=situation.turned,
    )
    return with_readings(still, wheel, gyro, pose, seen_first=seen_first)


def with_readings(drive: Observations, wheel: Floats, gyro: Floats, pose: Floats, *, seen_first: bool) -> Observations:
    """Return the drive with readings of 0 at these times [s]; with `seen_first` it begins at a pose."""
    if seen_first:
        pose = np.concatenate([[0.0, 0.0], pose])  # twice: a tracked point lies where the heading says
    use = np.full(len(pose), FOLLOWED, np.uint8)
    use[: 2 if seen_first else 0] = RESTART
    return replace(
        drive,
        wheel_time=wheel,
        wheel=np.zeros((len(wheel), 2)),
        wheel_use=np.ones((len(wheel), 2), np.uint8),
        gyro_time=gyro,
        gyro=np.zeros(len(gyro)),
        pose_time=pose,
        pose=np.zeros((len(pose), 3)),
        pose_use=use,
    )


def _commands(situation: Situation, movement: Movement) -> Commands:
    """Return the motors' commands: those not yet executed, the rest of the present movement, this one, and zero."""
    given, busy = situation.commands, situation.busy
    past = given.time < 0.0
    rest = ~past & (given.time < busy - 1e-9)
    time = np.concatenate([given.time[rest], busy + movement.time, [busy + movement.seconds]])
    duty = np.concatenate([given.duty[rest], movement.duty, [[0.0, 0.0]]])
    begin = given.duty[past][-1] if past.any() else np.zeros(2)
    times, duties = ramped(time, duty, situation.limits, (float(begin[0]), float(begin[1])))
    return Commands(np.concatenate([given.time[past], times]), np.concatenate([given.duty[past], duties]))


def _unseen(observations: Observations) -> Observations:
    """Return the drive with poses that do not correct the observer."""
    return replace(observations, pose_use=np.full(len(observations.pose), FOLLOWED, np.uint8))


def _read(observations: Observations, innovations: Innovations) -> Observations:
    """Return the drive with the readings of a free run; other contributions to them are 0."""
    wheel, gyro, pose = (np.ascontiguousarray(-one[..., 0]) for one in innovations[:3])
    return replace(observations, wheel=wheel, gyro=gyro, pose=pose)


def _segment(observations: Observations, number: int) -> Segment:
    """Return a drive as a recording of its own, so that it takes over no heat and charge from another one."""
    return Segment(observations, np.zeros((len(observations.wheel), 2)), 0.0, 0, number, np.empty((0, 2)))


def _white(batch: Batch, errors: Errors, noise: Noise, since: float) -> list[Floats]:
    """Return errors of a batch from `since` [s] on, whitened, (n, C) by segment; earlier ones do not differ."""
    parts: list[list[Floats]] = [[] for _ in batch.predictors]
    sums = foreign_sums(batch, errors)
    for name in batch.signals:
        known, ends = noise.of.get(name), batch.ends[name]
        if known is None or not any(map(len, known.sizes)):
            continue
        own = errors.of[name]
        if name in POSE_SIGNALS:
            own = own - sum(weight * other for weight, other in zip(known.foreign, sums, strict=True))
        size = float(np.median(np.concatenate(known.sizes)))
        spans = known.spans(name)
        pieces = [np.concatenate([np.zeros((sum(spans), own.shape[1])), one]) for one in np.split(own, ends[1:-1])]
        padded = ends_of([len(one) for one in pieces])
        white = np.empty((int(padded[-1]), own.shape[1]))
        whiten(
            np.ascontiguousarray(np.concatenate(pieces)), padded, *sums_of_past(known.past, spans),
            np.full(len(white), 1.0 / size), padded[:-1].copy(), white,
        )  # fmt: skip
        made_white = [one[sum(spans) :] for one in np.split(white, padded[1:-1])]
        if name == GYRO and isinstance(noise, NoiseWithRests):
            still = np.split(resting(batch), ends[1:-1])
            for one, plain, rows in zip(made_white, np.split(own, ends[1:-1]), still, strict=True):
                one[rows] = plain[rows] / noise.size
        for part, one, predictor in zip(parts, made_white, batch.predictors, strict=True):
            part.append(one[predictor.times[name] >= since])
    return [np.concatenate(part) for part in parts]
