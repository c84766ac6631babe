"""Reports of unused messages, waiting parameters, and robots that were moved by hand."""

from cmr.world.world import World

SPOKEN_OF = 2_000_000  # us for which a reset of an estimate is reported


def refusals(world: World, utime: int) -> list[str]:
    """Return sentences about recent refusals and waiting parameters, as of `utime` [us]."""
    moved = (
        f"Robot {robot_id} was put elsewhere: its poses agree on a place {reset.distance:.2f} m from where it was "
        "estimated, and the estimate was reset to its poses."
        for robot_id, reset in world.resets().items()
        if abs(utime - reset.utime) <= SPOKEN_OF
    )
    return [problem for problem in (world.gate.problem(), *moved, *world.waiting()) if problem]
