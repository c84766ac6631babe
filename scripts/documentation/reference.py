"""Write the generated pages of the reference into a folder that is not in git."""

from pathlib import Path

from documentation import command_pages, message_page, notebook_pages
from documentation.commands import PROJECT, modules, parsers_of

INTRODUCTION = """\
# Commands

Every command prints its description with `--help`. These pages are generated from the same parsers.

| command | purpose |
|---|---|"""
EXIT_CODES = """\
Exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted.
"""
SHARED = """\
## Common options

Options with the same meaning have the same name in every command. All commands have `--help`, `--version`, `--lcm-url`
and `--quiet`. Several commands have these options:

| option | commands |
|---|---|"""
EVERYWHERE = {"--help", "--version", "--lcm-url", "--quiet"}


def write_reference(folder: Path) -> None:
    """Write a page for each command and notebook, commands.md and notebooks.md with their lists, and messages.md."""
    pages = _command_pages()
    pages["messages.md"] = message_page.page(sorted((PROJECT / "lcmtypes").glob("*.lcm")))
    files = {name: text.encode() for name, text in pages.items()}
    files |= notebook_pages.pages(sorted((PROJECT / "docs" / "notebooks").glob("*.ipynb")))
    for name, data in files.items():
        _write(folder / name, data)
    for path in folder.rglob("*.*"):
        if path.relative_to(folder).as_posix() not in files:
            path.unlink()  # its command or notebook was removed


def _command_pages() -> dict[str, str]:
    pages, rows = {}, []
    having: dict[str, list[str]] = {}
    for command in modules():
        if parsers := parsers_of(command):
            name = f"commands/{command.replace(' ', '-')}"
            pages[f"{name}.md"] = command_pages.page(parsers)
            for option in command_pages.options_of(parsers):
                having.setdefault(option, []).append(f"[`{command}`]({name}.md)")
            rows.append(f"| [`{command}`]({name}.md) | {command_pages.escaped(command_pages.summary(parsers[0]))} |")
    hidden = [f"```{{toctree}}\n:hidden:\n:maxdepth: 1\n\n{chr(10).join(name[:-3] for name in pages)}\n```"]
    pages["commands.md"] = "\n".join([INTRODUCTION, *rows, "", EXIT_CODES, SHARED, *_shared(having), "", *hidden, ""])
    return pages


def _shared(having: dict[str, list[str]]) -> list[str]:
    """Return a row for each option that several commands have, without those that all have."""
    chosen = {option: commands for option, commands in sorted(having.items()) if option not in EVERYWHERE}
    return [f"| `{option}` | {', '.join(commands)} |" for option, commands in chosen.items() if len(commands) > 1]


def _write(path: Path, data: bytes) -> None:
    """Write a page only if it has changed, because Sphinx processes newer files again."""
    if path.is_file() and path.read_bytes() == data:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
