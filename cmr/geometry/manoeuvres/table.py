"""The manoeuvres by name: their purposes, and the space they need."""

from pathlib import Path
from textwrap import fill

from cmr.geometry.manoeuvres import drives
from cmr.geometry.manoeuvres.manoeuvre import STILL, Manoeuvre
from cmr.geometry.manoeuvres.pieces import Piece, rest

BETWEEN = "+"  # separates names in a sequence
WIDTH = 79  # characters of a line of help
ENDS = {"both ends", "at the end"}  # of a drive of a minute or more
LONG_REST = {"rest at the beginning", "stand still"}

PARTS = (  # contained in the rich drive
    Manoeuvre(
        name="straight_runs",
        what="straight runs forth and back at three speeds",
        good_for="wheel radii, drag",
        space=1.3,
        gives=frozenset({"any motion", "straight runs", "two speeds"}),
        pieces=drives.straight_runs,
    ),
    Manoeuvre(
        name="spins",
        what="spins on the spot both ways at three rates",
        good_for="base width at any turn rate, gyro, tracked point, wobbling wheels",
        space=0.3,
        gives=frozenset(
            {"any motion", "spins", "turns", "turns both ways", "fast turns", "sudden turns", "slow driving"}
        ),
        pieces=drives.spins,
    ),
    Manoeuvre(
        name="ramps",
        what="slow ramps of the duty through zero",
        good_for="friction, deadband",
        space=0.7,
        gives=frozenset({"any motion", "ramps", "slow ramps"}),
        pieces=drives.ramps,
    ),
    Manoeuvre(
        name="multisine",
        what="frequencies from 0.2 to 7.5 Hz at once",
        good_for="delay, lag, late or lost commands",
        space=0.5,
        gives=frozenset({"any motion", "multisine", "commands that change often", "changes of speed"}),
        pieces=drives.multisines,
    ),
    Manoeuvre(
        name="circles",
        what="circles of two radii both ways at two speeds",
        good_for="skid, slope",
        space=1.2,
        gives=frozenset(
            {"any motion", *ENDS, "circles", "circles at two speeds", "turns", "turns both ways", "all directions"}
        ),
        pieces=drives.circles,
    ),
    Manoeuvre(
        name="steps",
        what="big steps and reversals near full duty",
        good_for="battery and other limits, asymmetries, slip, backlash, payload",
        space=0.8,
        gives=frozenset(
            {"any motion", "changes of speed", "turns", "turns both ways", "sudden turns"}
            | {"steps", "big steps", "starts", "reversals", "full drive", "high duty"}
        ),
        pieces=drives.steps,
    ),
    Manoeuvre(
        name="one_sided_steps",
        what="big steps of one side while the other is held",
        good_for="yaw inertia, motors that warm up",
        space=1.1,
        gives=frozenset({"any motion", "steps", "steps of one side", "big steps on one side", "effort on one side"}),
        pieces=drives.one_sided_steps,
    ),
    Manoeuvre(
        name="rest",
        what="a rest of 30 s",
        good_for="bias and drift of the gyro",
        space=0.3,
        gives=frozenset({"rest", *LONG_REST}),
        pieces=drives.standstill,
    ),
)
WHOLE = (
    Manoeuvre(
        name="figure_eight",
        what="figure-eights forth and back at two speeds, half a minute each",
        good_for="a calibration where no leader drives ahead",
        space=1.0,
        gives=frozenset({"figure_eight"}),
        pieces=drives.figure_eights,
    ),
    Manoeuvre(
        name="chirp",
        what="rising frequencies from 0.25 to 4 Hz",
        good_for="seeing how late, and how far, a robot follows",
        space=0.6,
        gives=frozenset({"chirp"}),
        pieces=drives.chirps,
    ),
    Manoeuvre(
        name="repeat_loop",
        what="the same loop for minutes with pauses",
        good_for="what changes in the course of time",
        space=1.0,
        gives=frozenset(
            {"any motion", *ENDS, "loop", "minutes", "long drive", "longer run", "pauses"}
            | {"turns", "turns both ways", "all directions"}
        ),
        pieces=drives.repeat_loop,
    ),
    Manoeuvre(
        name="star",
        what="runs over one place in six directions",
        good_for="what depends on the place or the direction",
        space=2.2,
        gives=frozenset({"any motion", "straight runs", "all directions", "several sides", "area"}),
        pieces=drives.star,
    ),
    Manoeuvre(
        name="rich_drive",
        what="a drive with something of everything",
        good_for="finding any effect",
        space=1.4,
        gives=frozenset().union(*(manoeuvre.gives for manoeuvre in PARTS)) - LONG_REST,
        pieces=drives.rich_drive,
    ),
    Manoeuvre(
        name="short_drive",
        what="short movements of all kinds, each forth and back",
        good_for="finding most effects in a minute, on a small floor",
        space=0.8,
        gives=frozenset({"short_drive"}),
        pieces=drives.short_drive,
    ),
)
MANOEUVRES = {manoeuvre.name: manoeuvre for manoeuvre in (*PARTS, *WHOLE)}


class UnknownManoeuvreError(ValueError):
    """There is no manoeuvre of this name; the text lists those there are."""


def in_sequence(names: str) -> Manoeuvre:
    """Return the manoeuvre for `names`: one of the table or of a file (`.yaml`), or several joined by "+".

    Each is driven from rest to rest. Raises UnknownManoeuvreError for a name that is not in the table, and
    RecordedDriveError, also a ValueError, for an invalid file.
    """
    parts = [_manoeuvre(name) for name in names.split(BETWEEN)]

    def pieces(turn_time: float) -> list[Piece]:
        sequence = [[*part.pieces(turn_time), rest(2.0 * STILL)] for part in parts]
        return [piece for part in sequence for piece in part][:-1]

    return Manoeuvre(
        name=names,
        what=", then ".join(part.what for part in parts),
        good_for=", ".join(part.good_for for part in parts),
        space=max(part.space for part in parts),
        gives=frozenset().union(*(part.gives for part in parts)),
        pieces=pieces,
    )


def _manoeuvre(name: str) -> Manoeuvre:
    """Return the manoeuvre of this name, or the recorded drive of this file."""
    if name.endswith(".yaml"):
        from cmr.geometry.manoeuvres.recorded import load  # reads YAML, which is not needed for named manoeuvres

        return load(Path(name))
    if name not in MANOEUVRES:
        raise UnknownManoeuvreError(
            f"There is no manoeuvre {name!r}; there are {', '.join(MANOEUVRES)}, and files that end in .yaml."
        )
    return MANOEUVRES[name]


def help_text() -> str:
    """Return the help text on manoeuvres: duration, space, description and purpose."""
    return "\n".join(
        fill(
            f"{manoeuvre.what}: {manoeuvre.good_for}",
            WIDTH,
            initial_indent=f"  {manoeuvre.name:15s} {manoeuvre.duties().duration:4.0f} s  {manoeuvre.space:.1f} m  ",
            subsequent_indent=33 * " ",
        )
        for manoeuvre in MANOEUVRES.values()
    )
