"""Laws in files: as part of a parameter file, and as a file `law_*.yaml` of a single law, for sharing.

Their content is data in the grammar of `cmr.model.laws`; everything is validated before the model learns the law.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from cmr.documents.bounds import Bounds
from cmr.documents.document import DocumentError, Item, quoted, read, read_file
from cmr.files import write_atomically
from cmr.model.laws.law import PREFIX, Law, LawError

SCHEMA = 1
OF_A_LAW = ("place", "side", "formulas", "constants", "description")
PATTERN = f"{PREFIX}*.yaml"
MOST_LAWS = 8  # of one robot
MOST_SOURCES = 1000


class LawFileError(DocumentError):
    """The file of a law cannot be used; the text says what is wrong, in which line, and what is allowed."""

    between = ": "
    not_yaml = "cannot be read"
    empty = "it is not a YAML mapping with schema, law, place and formulas"
    bounds = Bounds(size=64_000, values=4_000, is_simple=True)


@dataclass(frozen=True)
class Coefficient:
    """The value of a law's coefficient on a robot, or on a family of robots; `std` is then its spread."""

    value: float
    std: float | None = None


@dataclass(frozen=True)
class LawFile:
    """A law with its fitted coefficients, if any, and the names of the files they come from."""

    law: Law
    coefficients: Mapping[str, Coefficient] = field(default_factory=dict)
    sources: tuple[str, ...] = ()

    def to_yaml(self) -> str:
        """Return the text of the file."""
        units = self.law.units
        lines = [f"schema: {SCHEMA}", f"law: {self.law.name}"]
        lines += [f"{key}: {flow(value)}" for key, value in law_content(self.law).items()]
        if self.coefficients:
            lines.append("coefficients:")
        for name, one in self.coefficients.items():
            spread = {} if one.std is None else {"std": float(one.std)}
            lines.append(f"  {name}: {flow({'value': float(one.value), 'unit': units[name], **spread})}")
        if self.sources:
            lines += ["sources:", *(f"  - {flow(source)}" for source in self.sources)]
        return "\n".join(lines) + "\n"


def read_law(path: Path) -> LawFile:
    """Read the file of a law.

    Raises LawFileError when it is missing, unreadable or wrong.
    """
    return _parsed(read_file(path, LawFileError))


def parse_law(text: str, source: str = "law") -> LawFile:
    """Parse the text of such a file; `source` names it in errors.

    Raises LawFileError saying what is wrong and where.
    """
    return _parsed(read(text, source, LawFileError))


def write_law(path: Path, content: LawFile) -> None:
    """Write the file of a law atomically.

    Raises OSError when the folder cannot be written.
    """
    write_atomically(content.to_yaml(), path)


def laws_beside(path: Path) -> list[Path]:
    """Return the law files in a folder, or beside a file, by name."""
    folder = path if path.is_dir() else path.parent
    return sorted(folder.glob(PATTERN))


def law_content(law: Law) -> dict[str, object]:
    """Return a law's entry in files, without its name."""
    return {
        "place": law.place,
        **({"side": law.side} if law.side else {}),
        "formulas": list(law.formulas),
        **({"constants": {name: float(value) for name, value in law.constants.items()}} if law.constants else {}),
        **({"description": law.description} if law.description else {}),
    }


def law_of(name: object, content: object) -> Law:
    """Return the law with a name and plain values; invalid ones raise a LawError with the keys."""
    if not isinstance(content, dict):
        raise LawError(f"must be a mapping with some of {', '.join(OF_A_LAW)}, not {quoted(content)}")
    unknown = [key for key in content if key not in OF_A_LAW]
    if unknown:
        raise LawError(f"unknown key {quoted(unknown[0])}; known are {', '.join(OF_A_LAW)}")
    formulas = content.get("formulas")
    if not isinstance(formulas, list):
        raise LawError(f"must be a list of formulas, not {quoted(formulas)}", "formulas")
    if not isinstance(name, str):
        raise LawError(f"the name of a law is text, not {quoted(name)}")
    return Law(
        name=name,
        place=content.get("place", ""),
        formulas=tuple(formulas),
        side=content.get("side", ""),
        constants=content.get("constants", {}),
        description=content.get("description", ""),
    )


@contextmanager
def learned(laws: Mapping[str, Law]) -> Iterator[None]:
    """Register laws in the model; new ones are removed again if the body of the context fails.

    Raises LawError where a name is taken.
    """
    from cmr.model import catalogue  # slow to load, and most files have no laws

    new = [name for name in laws if name not in catalogue.LAWS]
    try:
        for law in laws.values():
            catalogue.learn(law)
        yield
    except BaseException:
        for name in new:
            if name in catalogue.LAWS:
                catalogue.unlearn(name)
        raise


def flow(content: object) -> str:
    """Return YAML on one line, as in `{value: 118.0, unit: rad/s^2}`, without aliases."""
    text: str = yaml.dump(content, Dumper=_Dumper, default_flow_style=True, sort_keys=False, width=float("inf"))
    return text.removesuffix("...\n").strip()


class _Dumper(yaml.SafeDumper):
    """Writes repeated objects twice, without aliases."""

    def ignore_aliases(self, _data: object) -> bool:
        return True


def _parsed(root: Item) -> LawFile:
    content = root.value
    if not isinstance(content, dict):
        raise root.place.error(LawFileError.empty)
    root.check_keys()
    try:
        return _checked(content)
    except LawError as error:
        raise LawFileError(str(error), *error.within).placed(root) from None
    except LawFileError as error:
        raise error.placed(root) from None


def _checked(content: Mapping[object, object]) -> LawFile:
    if content.get("schema") != SCHEMA:
        raise LawFileError(
            f"schema is {quoted(content.get('schema'))}; this version reads schema {SCHEMA}", inside=("schema",)
        )
    own = {key: value for key, value in content.items() if key not in ("schema", "law", "coefficients", "sources")}
    law = law_of(content.get("law"), own)
    sources = content.get("sources", [])
    if not isinstance(sources, list) or len(sources) > MOST_SOURCES or not all(isinstance(s, str) for s in sources):
        raise LawFileError("must be a list of texts", "sources")
    return LawFile(law, _coefficients(law, content.get("coefficients", {})), tuple(sources))


def _coefficients(law: Law, content: object) -> dict[str, Coefficient]:
    if not isinstance(content, dict):
        raise LawFileError(f"must be a mapping of names to {{value, unit, std}}, not {quoted(content)}", "coefficients")
    found = {}
    for name, entry in content.items():
        if not isinstance(name, str) or name not in law.units:
            raise LawFileError(f"unknown name {quoted(name)}; known are {', '.join(law.units)}", "coefficients")
        if not isinstance(entry, dict) or "value" not in entry or not set(entry) <= {"value", "unit", "std"}:
            raise LawFileError("must be {value: number, unit: text, std: number}", "coefficients", name)
        if entry.get("unit", law.units[name]) != law.units[name]:
            raise LawFileError(f"unit is {quoted(entry['unit'])}, must be {law.units[name]}", "coefficients", name)
        numbers = [entry["value"], *([entry["std"]] if entry.get("std") is not None else [])]
        if not all(isinstance(one, (int, float)) and not isinstance(one, bool) and abs(one) <= 1e6 for one in numbers):
            raise LawFileError("must have numbers of at most 1e+06 either way", "coefficients", name)
        found[name] = Coefficient(*map(float, numbers))
    return found
