"""At a crossing everybody gets through, and nobody touches anybody."""

import math

import numpy as np
import pytest

from cmr.world.behaviours.crossing import BAND
from cmr.world.behaviours.right_of_way import RightOfWay
from tests.support.driver_bench import number
from tests.world.behaviours.team_bench import DIAMETER, Bench

pytestmark = pytest.mark.slow

ZONE = 0.8  # m from the middle to the line, as it is by default
LANE = 0.25  # m from the middle of the road; robots keep to the right
PARKED = 0.6  # m between those that have arrived, which stand beside the road
ARMS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # directions of driving


def bench_of(seed: int, rule: str, teams: int) -> tuple[Bench, list[tuple[float, float]]]:
    """Return eight robots in random queues on four arms, straight on or turning, and where each is to arrive."""
    random = np.random.default_rng(seed)
    behaviours = [RightOfWay(rule=rule, speed=0.3 + 0.01 * k) for k in range(teams)]
    queue, arrived = [0] * 4, [0] * 4
    poses, ends = [], []
    for robot in range(8):
        arm = int(random.integers(4))
        ax, ay = ARMS[arm]
        out = ARMS[(arm + int(random.choice([0, 1, 3]))) % 4]
        back = 1.4 + 0.5 * queue[arm] + random.uniform(0.0, 0.15)
        queue[arm] += 1
        poses.append((-back * ax + LANE * ay, -back * ay - LANE * ax, math.atan2(ay, ax)))
        far = 2.0 + PARKED * arrived[ARMS.index(out)]
        arrived[ARMS.index(out)] += 1
        turn = (LANE * (ay + out[1]), -LANE * (ax + out[0]))
        leaves = (far * out[0] + LANE * out[1], far * out[1] - LANE * out[0])
        ends.append((leaves[0] + PARKED * out[1], leaves[1] - PARKED * out[0]))
        path = [*([turn] if out != (ax, ay) else []), leaves, ends[-1]]
        behaviours[robot % teams].take_waypoints(robot, [p[0] for p in path], [p[1] for p in path])
    members = [(behaviour, range(k, 8, teams)) for k, behaviour in enumerate(behaviours)]
    return Bench(poses, members), ends


@pytest.mark.parametrize("seed", range(number("CMR_SEEDS", 2)))
@pytest.mark.parametrize(("rule", "teams"), [("right", 1), ("first", 1), ("right", 2), ("first", 2)])
def test_everybody_gets_through_and_nobody_touches_anybody(seed: int, rule: str, teams: int) -> None:
    bench, ends = bench_of(seed, rule, teams)
    to_x, to_y = np.array(ends).T

    def all_there() -> bool:
        return bool((np.hypot(bench.x - to_x, bench.y - to_y) < 0.1).all())

    came: dict[int, None] = {}  # near the line, and over it, in this order
    went: dict[int, None] = {}
    for _ in bench.run(150.0, until=all_there):
        assert bench.nearest() > DIAMETER
        away = np.hypot(bench.x, bench.y)
        came.update(dict.fromkeys(np.flatnonzero(away < ZONE + BAND).tolist()))
        went.update(dict.fromkeys(np.flatnonzero(away < ZONE).tolist()))
    assert all_there()
    if rule == "first":
        assert list(went) == list(came)
