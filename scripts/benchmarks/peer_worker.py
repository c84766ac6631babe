"""Build a world of N robots in another simulator, a peer, and time its step on request.

Usage: PYTHONPATH=scripts python -m benchmarks.peer_worker {mujoco,mujoco_contacts,irsim,vmas} N. Prints the version of
the peer. Then, for each number of steps on standard input, it makes these steps and prints their CPU seconds, and the
number of contacts in the last step. Of CMR, it imports only `crowd`, which needs nothing else, so it runs in a separate
environment.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias

from benchmarks.crowd import RADIUS, SPEED, TURN_RATE, WARM_UP, crowd

Run: TypeAlias = Callable[[int], int]  # makes this many steps; returns the contacts of the last one

STEP = 0.01  # s
APART = 3.0  # m between robots on a grid, too far apart to meet


def places(robots: int) -> list[tuple[float, float]]:
    """Return the starts of the robots on a square grid [m]."""
    columns = int(robots**0.5) + 1
    return [(APART * (1 + i % columns), APART * (1 + i // columns)) for i in range(robots)]


def mujoco(robots: int) -> Run:
    """Return the step function of planar bodies far from each other, without contacts."""
    model = mujoco_model([(x, y, 0.0) for x, y in places(robots)], '<flag contact="disable"/>')
    data = import_module("mujoco").MjData(model)
    data.ctrl[:] = 0.3
    return mujoco_run(model, data, lambda _step: None)


def mujoco_contacts(robots: int) -> Run:
    """Return the step function of the crowd: planar bodies that drive circles and collide.

    Spheres without friction in one plane collide as discs do, and are the fastest shape in MuJoCo.
    """
    numpy: Any = import_module("numpy")

    starts = crowd(robots)
    model = mujoco_model(starts, "")
    data = import_module("mujoco").MjData(model)
    heading = numpy.array(starts)[:, 2]

    def drive(step: int) -> None:
        now = heading + TURN_RATE * STEP * step
        data.ctrl[0::3], data.ctrl[1::3] = SPEED * numpy.cos(now), SPEED * numpy.sin(now)

    data.ctrl[2::3] = TURN_RATE
    run = mujoco_run(model, data, drive)
    run(WARM_UP)
    return run


MEMORY = "2G"  # for 10,000 bodies; MuJoCo's own default is more than is available


def mujoco_model(starts: list[tuple[float, float, float]], flag: str) -> Any:
    """Return a model of bodies, each with two slide joints, one hinge, and a velocity actuator for each joint."""
    library: Any = import_module("mujoco")

    gains = {"x": 5.0, "y": 5.0, "t": 0.1}  # the inertia about the hinge is small; a larger gain would be unstable
    bodies, motors = [], []
    for i, (x, y, _theta) in enumerate(starts):
        joints = [("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("t", "hinge", "0 0 1")]
        bodies.append(
            f'<body pos="{x} {y} 0"><geom type="sphere" size="{RADIUS}" mass="1" condim="1"/>'
            + "".join(f'<joint name="{name}{i}" type="{kind}" axis="{axis}"/>' for name, kind, axis in joints)
            + "</body>"
        )
        motors += [f'<velocity joint="{name}{i}" kv="{gain}"/>' for name, gain in gains.items()]
    return library.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP}" gravity="0 0 0">{flag}</option>'
        f'<size memory="{MEMORY}"/>'
        f"<worldbody>{''.join(bodies)}</worldbody><actuator>{''.join(motors)}</actuator></mujoco>"
    )


def mujoco_run(model: Any, data: Any, command: Callable[[int], None]) -> Run:
    """Return the step function of a model; before each step, `command` is called with its number."""
    library: Any = import_module("mujoco")

    numbers = count()

    def run(steps: int) -> int:
        for _ in range(steps):
            command(next(numbers))
            library.mj_step(model, data)
        return int(data.ncon)

    return run


def irsim(robots: int) -> Run:
    """Return the step function of differential-drive robots without sensors, collision checks or display."""
    library: Any = import_module("irsim")

    side = APART * (robots**0.5 + 3)
    lines = [f"world: {{height: {side}, width: {side}, step_time: {STEP}, collision_mode: unobstructed}}", "robot:"]
    for x, y in places(robots):
        lines.append(f"  - {{kinematics: {{name: diff}}, shape: {{name: circle, radius: 0.1}}, state: [{x}, {y}, 0]}}")
    with tempfile.TemporaryDirectory() as folder:
        world = Path(folder) / "world.yaml"
        world.write_text("\n".join(lines))
        environment = library.make(str(world), display=False, disable_all_plot=True, headless=True, log_level="ERROR")
    actions = [[0.3, 0.3]] * robots

    def run(steps: int) -> int:
        for _ in range(steps):
            environment.step(actions)
        return 0

    return run


def vmas(robots: int) -> Run:
    """Return the step function of agents that do not collide, with constant forces, in a batch of one environment."""
    torch: Any = import_module("torch")
    core: Any = import_module("vmas.simulator.core")

    torch.set_num_threads(1)
    world = core.World(batch_dim=1, device=torch.device("cpu"), dt=STEP)
    for i, (x, y) in enumerate(places(robots)):
        agent = core.Agent(name=f"robot {i}", collide=False)
        world.add_agent(agent)
        agent.state.pos = torch.tensor([[x, y]])
        agent.state.force, agent.state.torque = torch.full((1, 2), 0.3), torch.full((1, 1), 0.01)

    def run(steps: int) -> int:
        for _ in range(steps):
            world.step()
        return 0

    return run


PEERS = {
    "mujoco": ("mujoco", mujoco),
    "mujoco_contacts": ("mujoco", mujoco_contacts),
    "irsim": ("ir-sim", irsim),
    "vmas": ("vmas", vmas),
}


def main() -> None:
    """Build the world, then time steps on request."""
    package, build = PEERS[sys.argv[1]]
    answers, sys.stdout = sys.stdout, sys.stderr  # output of libraries must not mix with answers
    run = build(int(sys.argv[2]))
    run(1)
    print(version(package), file=answers, flush=True)
    for line in sys.stdin:
        before = time.process_time()
        contacts = run(int(line))
        print(time.process_time() - before, contacts, file=answers, flush=True)


if __name__ == "__main__":
    main()
