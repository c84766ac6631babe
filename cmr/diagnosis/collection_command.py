"""cmr-laws: compare laws found on robots over robots and days, and keep them as entries."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from cmr.cli.command_line import add_json, check_writable, parser, print_json
from cmr.cli.errors import CommandError
from cmr.diagnosis.collection import (
    GOES_WITH,
    SURE,
    Family,
    Sighting,
    families,
    family_of,
    proposal,
    renamed,
    sightings,
)
from cmr.model.laws.law import LawError
from cmr.model.laws.sentence import equation, headline
from cmr.parameters.file import ParameterFileError, load
from cmr.parameters.laws import LawFile, learned, write_law

INDENT = "  "


def main(arguments: list[str]) -> int:
    """Run cmr-laws.

    Raises CommandError where a file cannot be used or written, or where the options do not go together.
    """
    options = command_parser().parse_args(arguments)
    found = _found(options.paths)
    by_law = [one for one in families(found) if not options.law or any(s.law.name == options.law for s in one)]
    if options.law and not by_law:
        known = ", ".join(sorted({one.law.name for one in found})) or "none"
        raise CommandError(f"no parameter file has the law {options.law}; found: {known}")
    if (options.name or options.description) and (not options.out or len(by_law) != 1):
        raise CommandError(
            "--name and --description are for one law that is kept: name it by --law, and a folder by --out"
        )
    written = _kept(by_law, options) if options.out else []
    if options.json:
        print_json({"laws": [_as_json(one) for one in by_law], "written": [str(path) for path in written]})
        return 0
    print("\n\n".join(map(_text, by_law)) or "No law was found in these parameter files.")
    for path in written:
        print(f"written: {path}")
    return 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-laws."""
    result = parser(
        "cmr-laws",
        "List the laws that cmr-diagnose found on robots, compare the same law over robots and days, and propose one "
        "entry for all of them, with the spread of its coefficient.\n\nWith --out the entry is written as a file "
        "law_*.yaml, to be kept and shared: `cmr-diagnose --laws` tests it by name on the next recording.",
        "cmr-laws diagnoses/\n  cmr-laws diagnoses/ --law law_yaw_rate_w_abs_v --out laws --name law_turn_cost",
    )
    result.add_argument(
        "paths", type=Path, nargs="+", metavar="PATH", help="parameter files, or folders of diagnoses with robot_N.yaml"
    )
    result.add_argument("--law", metavar="NAME", default="", help="this law only (default: all)")
    result.add_argument("--out", type=Path, metavar="DIR", help="folder for the files of the laws, law_*.yaml")
    result.add_argument(
        "--name", metavar="NAME", help="another name for the law, law_...; parameter files with it go to --out"
    )
    result.add_argument("--description", metavar="TEXT", help="what the law says, in your own words")
    add_json(result)
    return result


def _found(paths: Sequence[Path]) -> list[Sighting]:
    missing = next((path for path in paths if not path.exists()), None)
    if missing:
        raise CommandError(f"{missing}: no such file or folder")
    try:
        return sightings(paths)
    except ParameterFileError as error:
        raise CommandError(str(error)) from error


def _kept(by_law: Sequence[Sequence[Sighting]], options: argparse.Namespace) -> list[Path]:
    """Write the file of each law, and with another name the parameter files, too; return what was written."""
    check_writable(options.out)
    options.out.mkdir(parents=True, exist_ok=True)
    written = []
    for found in by_law:
        try:
            entry = proposal(found, options.name or "", options.description or "")
            written.append(options.out / f"{entry.law.name}.yaml")
            write_law(written[-1], entry)
            if options.name:
                written += _renamed(found, entry, options.out)
        except (LawError, ParameterFileError) as error:
            raise CommandError(f"{options.name or found[0].law.name}: {error}") from error
    return written


def _renamed(found: Sequence[Sighting], entry: LawFile, folder: Path) -> list[Path]:
    """Write the parameter files with the law under its new name, those of one robot and more under numbers."""
    written: list[Path] = []
    for one in found:
        file = load(Path(one.source))
        with learned({entry.law.name: entry.law}):
            again = renamed(file, one.law, entry.law)
        name = f"robot_{file.robot_id}"
        path = folder / f"{name}.yaml"
        while path in written:
            path = folder / f"{name}_{sum(other.stem.startswith(name) for other in written) + 1}.yaml"
        again.save(path)
        written.append(path)
    return written


def _text(found: Sequence[Sighting]) -> str:
    """Describe a law with the robots it was found on, and the comparison."""
    law = found[0].law
    middle = {name: family_of(found, k).mean for k, name in enumerate(law.coefficients)}
    lines = [f"{law.name}: {headline(law, middle)}: {equation(law, middle)}"]
    if law.description:
        lines.append(f"{INDENT}{law.description}")
    width = max(len(one.source) for one in found)
    for one in found:
        numbers = ", ".join(
            _number(c.value, c.std, law.units[name]) for name, c in zip(law.coefficients, one.coefficients, strict=True)
        )
        lines.append(f"{INDENT}robot {one.robot_id:<4d} {one.written:%Y-%m-%d}  {one.source:{width}s}  {numbers}")
    for number, name in enumerate(law.coefficients):
        lines += [
            f"{INDENT}{sentence}" for sentence in _sentences(name, law.units[name], family_of(found, number), found)
        ]
    return "\n".join(lines)


def _sentences(name: str, unit: str, family: Family, found: Sequence[Sighting]) -> list[str]:
    """Return sentences on the comparison of a coefficient."""
    if len(found) == 1:
        return [f"{name} was found once: nothing is known of how it varies."]
    robots = len({one.robot_id for one in found})
    on = f"{robots} robots" if robots > 1 else "1 robot"
    entry = _number(family.mean, family.std, unit)
    result = [f"One entry for {on} and {len(found)} files: {name} = {entry}, of which {family.spread:.2g} is spread."]
    result += _differs("It differs between robots", family.between, "Robots differ no more than chance makes them")
    result += _differs(
        "It differs between days of one robot", family.within, "Days of one robot differ no more than chance makes them"
    )
    for other, share in family.goes_with.items():
        direction = "grows" if share > 0.0 else "falls"
        result.append(f"It {direction} with {other} (correlation {share:.2f}): {GOES_WITH[other]} may move it.")
    return result


def _differs(words: str, probability: float, otherwise: str) -> list[str]:
    if math.isnan(probability):
        return []
    return [f"{words if probability < SURE else otherwise} (p = {probability:.2g})."]


def _number(value: float, std: float | None, unit: str) -> str:
    spread = f" +- {std:.2g}" if std is not None and math.isfinite(std) else ""
    return f"{value:.4g}{spread}{'' if unit == '-' else ' ' + unit}"


def _as_json(found: Sequence[Sighting]) -> dict[str, object]:
    law = found[0].law
    coefficients = {}
    for number, name in enumerate(law.coefficients):
        family = family_of(found, number)
        coefficients[name] = {
            "unit": law.units[name],
            "mean": family.mean,
            "std": family.std,
            "spread": family.spread,
            "p_robots_differ": None if math.isnan(family.between) else family.between,
            "p_days_differ": None if math.isnan(family.within) else family.within,
            "goes_with": dict(family.goes_with),
        }
    return {
        "name": law.name,
        "place": law.place,
        "side": law.side,
        "formulas": list(law.formulas),
        "constants": list(law.constants),
        "description": law.description,
        "coefficients": coefficients,
        "found": [
            {
                "robot_id": one.robot_id,
                "written": one.written.isoformat(),
                "source": one.source,
                "values": [c.value for c in one.coefficients],
                "stds": [c.std for c in one.coefficients],
                "constants": dict(one.law.constants),
            }
            for one in found
        ],
    }
