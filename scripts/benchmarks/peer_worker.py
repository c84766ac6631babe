"""One peer in its own process: builds a world of N robots and times its step when it is told to.

Usage: python peer_worker.py {mujoco,irsim,vmas} N. It prints its version, then for each number of steps on standard
input the CPU seconds that so many steps took. Nothing of CMR is imported, so it runs in an environment of its own.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

STEP = 0.01  # s
APART = 3.0  # m; robots stand on a grid, too far from each other to meet


def places(robots: int) -> list[tuple[float, float]]:
    """Return where the robots start, on a square grid."""
    columns = int(robots**0.5) + 1
    return [(APART * (1 + i % columns), APART * (1 + i // columns)) for i in range(robots)]


def mujoco(robots: int) -> Callable[[int], Any]:
    """Return the stepping of planar bodies: two slides, one hinge and three velocity actuators each, no contacts."""
    library: Any = import_module("mujoco")

    gains = {"x": 5.0, "y": 5.0, "t": 0.1}  # the hinge turns a small inertia; more would not be stable
    bodies, motors = [], []
    for i, (x, y) in enumerate(places(robots)):
        joints = [("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("t", "hinge", "0 0 1")]
        bodies.append(
            f'<body pos="{x} {y} 0"><geom type="cylinder" size="0.1 0.05" mass="1"/>'
            + "".join(f'<joint name="{name}{i}" type="{kind}" axis="{axis}"/>' for name, kind, axis in joints)
            + "</body>"
        )
        motors += [f'<velocity joint="{name}{i}" kv="{gain}"/>' for name, gain in gains.items()]
    model = library.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP}" gravity="0 0 0"><flag contact="disable"/></option>'
        f"<worldbody>{''.join(bodies)}</worldbody><actuator>{''.join(motors)}</actuator></mujoco>"
    )
    data = library.MjData(model)
    data.ctrl[:] = 0.3

    def run(steps: int) -> None:
        for _ in range(steps):
            library.mj_step(model, data)

    return run


def irsim(robots: int) -> Callable[[int], Any]:
    """Return the stepping of differential-drive robots without sensors, collision checks and display."""
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

    def run(steps: int) -> None:
        for _ in range(steps):
            environment.step(actions)

    return run


def vmas(robots: int) -> Callable[[int], Any]:
    """Return the stepping of a world of agents that do not collide, forces set once, one environment in the batch."""
    torch: Any = import_module("torch")
    core: Any = import_module("vmas.simulator.core")

    torch.set_num_threads(1)
    world = core.World(batch_dim=1, device=torch.device("cpu"), dt=STEP)
    for i, (x, y) in enumerate(places(robots)):
        agent = core.Agent(name=f"robot {i}", collide=False)
        world.add_agent(agent)
        agent.state.pos = torch.tensor([[x, y]])
        agent.state.force, agent.state.torque = torch.full((1, 2), 0.3), torch.full((1, 1), 0.01)

    def run(steps: int) -> None:
        for _ in range(steps):
            world.step()

    return run


PEERS = {"mujoco": ("mujoco", mujoco), "irsim": ("ir-sim", irsim), "vmas": ("vmas", vmas)}


def main() -> None:
    """Build the world, then time steps as told."""
    package, build = PEERS[sys.argv[1]]
    answers, sys.stdout = sys.stdout, sys.stderr  # what libraries print is no answer
    run = build(int(sys.argv[2]))
    run(1)
    print(version(package), file=answers, flush=True)
    for line in sys.stdin:
        before = time.process_time()
        run(int(line))
        print(time.process_time() - before, file=answers, flush=True)


if __name__ == "__main__":
    main()
