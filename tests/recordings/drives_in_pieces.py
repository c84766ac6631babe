"""Made-up recordings in pieces, as other people's tables hold them: plain kinematics without the model's code.

A robot drives all the time; what is recorded are pieces of its drive, most of which begin and end in motion. On the
recording's clock the pieces follow one another with pauses between them in which nothing was recorded.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cmr.recordings import Recording
from cmr.recordings.signal import Floats, Signal

EPOCH = 1_600_000_000_000_000  # us
RASTER = 0.0025  # s of the simulation
HARDEST = 10.0  # m/s^2
SIDES = ("left", "right")
NONE = {
    "commands": SIDES,
    "wheels": tuple(f"{what}_{side}" for what in ("ticks", "psi", "applied") for side in SIDES),
    "gyro": ("yaw_rate",),
    "poses": ("x", "y", "theta"),
}


@dataclass(frozen=True)
class Shape:
    """What a recording is like: everything that differs between other people's robots and tables.

    `lengths` [s] are those of its pieces, `pause` [s] lies between them. Rates are in Hz; 0 means that the signal was
    not recorded. `frame` tells in what the poses of a piece are: "world", or "own" of the piece, whose first pose is
    then 0, 0, 0. `psi` tells whether a wheel's speed is that of the moment or the mean since the reading before,
    `counters` whether they go on through the pauses, as if nothing had turned or as it turned, or begin again.
    """

    seed: int
    lengths: tuple[float, ...] = (2.0,) * 40
    pause: float = 5.0
    poses: float = 10.0
    wheels: float = 20.0
    gyro: float = 50.0
    commands: float = 20.0
    frame: str = "own"
    manner: str = "steps"
    psi: str = "moment"
    counters: str = "recorded"
    noise: float = 0.01  # m of the poses; headings are half as many rad off
    latency: float = 0.0  # s by which poses are stamped late
    tick: float = 2.0 * np.pi / 4096  # rad
    slip: float = 0.2  # s: so much of the forward speed is lost for each rad/s of turning
    response: float = 0.15  # s, time constant of the wheels


def drawn(seed: int) -> Shape:
    """Return a shape drawn from all that are to be clean."""
    rng = np.random.default_rng([seed, 1])
    count = int(rng.integers(1, 60))
    lengths = (
        np.full(count, 2.0),
        rng.uniform(2.0, 10.0, count),
        rng.uniform(1.0, 4.0, count),
        np.full(max(count // 6, 1), 20.0),
        rng.uniform(30.0, 90.0, 1),
    )[rng.integers(5)]
    has = rng.uniform(size=3) < 0.7
    rates = {
        "wheels": has[0] * float(rng.choice([10.0, 20.0, 50.0, 100.0])),
        "commands": has[1] * float(rng.choice([5.0, 10.0, 20.0, 50.0])),
        "gyro": has[2] * float(rng.choice([20.0, 50.0, 100.0, 200.0])),
    }
    return Shape(
        seed,
        tuple(lengths.tolist()),
        pause=float(rng.choice([1.0, 5.0, 5.0, 30.0, 3600.0])),
        poses=float(rng.choice([5.0, 7.0, 10.0, 20.0, 50.0, 100.0, 200.0])),
        frame=str(rng.choice(["own", "own", "world"])),
        manner=str(rng.choice(["steps", "held", "waves"])),
        psi=str(rng.choice(["moment", "mean"])),
        counters=str(rng.choice(["recorded", "driven", "again"])),
        noise=float(rng.choice([0.0005, 0.002, 0.005, 0.02, 0.05])),
        tick=2.0 * np.pi / float(rng.choice([256, 4096, 65536])),
        slip=float(rng.choice([0.0, 0.05, 0.3])),
        response=float(rng.choice([0.08, 0.15, 0.3])),
        **rates,
    )


@dataclass(frozen=True)
class Drive:
    """How the robot really moved: each of shape (n,), `RASTER` apart; `asked` and `turned` [rad/s, rad], (n, 2)."""

    asked: Floats
    speed: Floats
    turned: Floats
    place: np.typing.NDArray[np.complex128]
    theta: Floats


def recorded(shape: Shape) -> Recording:
    """Return a recording of this shape."""
    rng = np.random.default_rng([shape.seed, 2])
    between = rng.uniform(0.3, 2.0, len(shape.lengths))  # s for which the robot drives on unseen
    begins = 3.0 + np.append(0.0, np.cumsum(np.array(shape.lengths) + between)[:-1])
    whole = (
        len(begins) == 1 and shape.lengths[0] >= 20.0 and rng.uniform() < 0.5
    )  # from the rest before the drive to the rest after it
    if whole:
        begins[0] = 0.0
    drive = _driven(shape, float(begins[-1] + shape.lengths[-1]), 1.5 if whole else 0.0, rng)
    parts = [
        _piece(shape, drive, float(begin), length, rng) for begin, length in zip(begins, shape.lengths, strict=False)
    ]
    clock = np.append(0.0, np.cumsum(np.array(shape.lengths) + shape.pause)[:-1])
    shifts = [round(1e6 * (at - begin)) for at, begin in zip(clock, begins, strict=False)]
    signals = {name: _joined([part[name] for part in parts], shifts, names) for name, names in NONE.items()}
    wheels = signals["wheels"]
    _count(shape, wheels, parts)
    return Recording(0, **signals)  # type: ignore[arg-type]


def _driven(shape: Shape, seconds: float, rest: float, rng: np.random.Generator) -> Drive:
    """Drive for `seconds`: 1 s of rest, then as the manner says, in the end a `rest` [s] again."""
    count = int((seconds + 1.0) / RASTER)
    time = np.asarray(np.arange(count) * RASTER, np.float64)
    radius, width, fast = (float(rng.uniform(*span)) for span in ((0.03, 0.2), (0.15, 0.8), (0.4, 1.5)))
    fast = min(fast, HARDEST * shape.response / 1.4)
    asked = _asked(shape.manner, time, rng) * fast / radius
    asked[(time < 1.0) | (time > seconds - rest) & (rest > 0.0)] = 0.0
    share = RASTER / shape.response
    speed = np.zeros_like(asked)
    now = np.zeros(2)
    for k in range(count):
        now = now + share * (asked[k] - now)
        speed[k] = now
    omega = radius * (speed[:, 1] - speed[:, 0]) / (width * 1.6)
    v = 0.5 * radius * speed.sum(axis=1) * np.maximum(1.0 - shape.slip * np.abs(omega), 0.4)
    theta = np.cumsum(omega) * RASTER
    place = np.cumsum((v + 0.1j * width * omega) * np.exp(1j * theta)) * RASTER
    return Drive(asked, speed, np.cumsum(speed, axis=0) * RASTER, np.asarray(place, np.complex128), theta)


def _asked(manner: str, time: Floats, rng: np.random.Generator) -> Floats:
    """Return what is asked of the wheels, as a share of fast driving, shape (n, 2)."""
    if manner == "waves":
        rates, phases = rng.uniform(0.3, 2.5, (2, 3)), rng.uniform(0.0, 6.0, (2, 3))
        waves = [np.sin(np.outer(time, rates[side]) + phases[side]).mean(axis=1) for side in (0, 1)]
        return 0.35 + 0.65 * np.stack(waves, axis=1)
    lasting = 1.0 if manner == "steps" else 4.0
    number = np.floor(time / lasting).astype(np.int64)
    levels = rng.uniform(-0.4, 1.0, (number[-1] + 1, 2))
    return levels[number]


def _piece(
    shape: Shape, drive: Drive, begin: float, length: float, rng: np.random.Generator
) -> dict[str, dict[str, Floats]]:
    """Return what is recorded of a piece, by signal: `time` of the drive [s] and the fields."""
    grid = np.arange(len(drive.theta)) * RASTER

    def times(rate: float, jitter: float = 0.0) -> Floats:
        count = int(length * rate + 1e-9)
        return begin + (np.arange(count) + jitter * rng.uniform(-0.2, 0.2, count)) / rate if rate else np.empty(0)

    def at(time: Floats, values: Floats) -> Floats:
        return np.interp(time, grid, values)

    found: dict[str, dict[str, Floats]] = {}
    time = times(shape.commands)
    full = np.abs(drive.asked).max() + 1e-9
    index = np.minimum(np.searchsorted(grid, time), len(grid) - 1)
    found["commands"] = {"time": time, **{side: drive.asked[index, k] / full for k, side in enumerate(SIDES)}}
    time = times(shape.wheels)
    found["wheels"] = {"time": time}
    for k, side in enumerate(SIDES):
        angle = at(time, drive.turned[:, k])
        before = at(time - 1.0 / shape.wheels, drive.turned[:, k]) if shape.wheels else angle
        mean = (np.floor(angle / shape.tick) - np.floor(before / shape.tick)) * shape.tick * shape.wheels
        found["wheels"] |= {
            f"psi_{side}": at(time, drive.speed[:, k]) if shape.psi == "moment" else mean,
            f"ticks_{side}": np.floor(angle / shape.tick),
            f"applied_{side}": np.full(len(time), np.nan),
        }
    time = times(shape.gyro)
    omega = at(time, np.gradient(drive.theta, RASTER))
    found["gyro"] = {"time": time, "yaw_rate": 1.02 * omega + 0.01 + rng.normal(0.0, 0.01, len(time))}
    found["poses"] = _poses(shape, times(shape.poses, 0.3), at, drive, rng)
    return found


def _poses(
    shape: Shape, time: Floats, at: Callable[[Floats, Floats], Floats], drive: Drive, rng: np.random.Generator
) -> dict[str, Floats]:
    count = len(time)
    seen = time - shape.latency
    place = at(seen, np.real(drive.place)) + 1j * at(seen, drive.place.imag)
    place = place + shape.noise * (rng.normal(size=count) + 1j * rng.normal(size=count))
    theta = at(seen, drive.theta) + 0.5 * shape.noise * rng.normal(size=count)
    if shape.frame == "own" and count:
        place, theta = (place - place[0]) * np.exp(-1j * theta[0]), theta - theta[0]
    return {"time": time, "x": place.real, "y": place.imag, "theta": np.remainder(theta + np.pi, 2.0 * np.pi) - np.pi}


def _joined(parts: list[dict[str, Floats]], shifts: list[int], names: tuple[str, ...]) -> Signal:
    utime = [
        EPOCH + shift + np.round(1e6 * part["time"]).astype(np.int64)
        for part, shift in zip(parts, shifts, strict=False)
    ]
    return Signal(np.concatenate(utime), {name: np.concatenate([part[name] for part in parts]) for name in names})


def _count(shape: Shape, wheels: Signal, parts: list[dict[str, dict[str, Floats]]]) -> None:
    """Let the counters go on through the pauses as the shape says."""
    if not len(wheels):
        return
    first = np.cumsum([0] + [len(part["wheels"]["time"]) for part in parts])[:-1]
    for side in SIDES:
        ticks = wheels.fields[f"ticks_{side}"]
        jump = np.append(0.0, np.diff(ticks)[first[1:] - 1])
        if shape.counters == "driven":
            continue
        begun = ticks[first]
        for k, at in enumerate(first):
            end = first[k + 1] if k + 1 < len(first) else len(ticks)
            ticks[at:end] -= begun[k] if shape.counters == "again" else jump[: k + 1].sum()
