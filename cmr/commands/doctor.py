"""cmr doctor: check whether this computer can run robots, with remedies."""

import argparse
import os
import time
from collections.abc import Callable
from typing import NamedTuple

from cmr.bus.keys import shown
from cmr.bus.preflight import BusError, is_shared, key_of, open_lcm, resolve_url, self_test, warnings
from cmr.cli.command_line import add_json, parser, print_json
from cmr.cli.errors import ExpectedError
from cmr.distribution import has_module, installed

GREEN, AMBER, RED = "green", "amber", "red"
NAPS, NAP = 100, 0.005  # like the naps in cmr-driver's loop
LATE = 0.020  # s; a later turn of the driver loses readings
SECURE_CORES = 2
FIRST_USE = "cmr.commands.first_use"
SOURCES = "CMR runs from its sources."
TIME_ERROR = 5  # adjtimex(2): the clock is not synchronised


class Finding(NamedTuple):
    """The result of a check: a colour, a sentence, and a remedy unless green."""

    colour: str
    sentence: str
    remedy: str = ""


def main(arguments: list[str]) -> int:
    """Run cmr doctor; return 1 if anything is red."""
    options = command_parser().parse_args(arguments)
    findings = {name: check() for name, check in checks(options.lcm_url).items()}
    if options.json:
        print_json({name: finding._asdict() for name, finding in findings.items()})
    else:
        _show(findings)
    return int(any(finding.colour == RED for finding in findings.values()))


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr doctor."""
    options = parser(
        "cmr doctor",
        "Check whether this computer can run robots: the installation, the bus and its key, serial ports and "
        "permissions, clock, real-time priority, compiled model and CPU. What is red keeps something from working; "
        "what is amber matters for real robots or several computers. Each comes with its remedy. The exit code is 1 if "
        "anything is red.",
        "cmr doctor\n  cmr doctor --json",
    )
    add_json(options)
    return options


def checks(url: str | None) -> dict[str, Callable[[], Finding]]:
    """Return all checks by name, in display order."""
    model = {"compiled model": compiled_model} if has_module(FIRST_USE) else {}  # the driver alone does not simulate
    return {
        "installation": installation,
        "bus": lambda: bus(resolve_url(url)),
        "key": lambda: key(resolve_url(url)),
        "ports": ports,
        "permissions": permissions,
        "clock": clock,
        "real-time priority": real_time_priority,
        **model,
        "CPU": cpu,
    }


def installation() -> Finding:
    """Check that there is only one installation: two overwrite each other's files."""
    found = installed()
    if len(found) > 1:
        return Finding(
            RED,
            f"{' and '.join(found)} are installed in one environment; they hold the same files.",
            f"pip uninstall {' '.join(found)}, then install one of them.",
        )
    return Finding(GREEN, "".join(f"{name} {version} is installed." for name, version in found.items()) or SOURCES)


def bus(url: str) -> Finding:
    """Send a message to this process over the bus at `url`."""
    try:
        opened = open_lcm(url)
        self_test(opened, url)
        lost = warnings(url)
    except BusError as error:
        sentence, _, remedy = str(error).partition(". ")
        return Finding(RED, f"{sentence.rstrip('.')}.", remedy)
    if lost:
        sentence, _, remedy = lost[0].partition(". ")
        return Finding(AMBER, f"{sentence}.", remedy)
    return Finding(GREEN, f"A message on {url} comes back.")


def key(url: str) -> Finding:
    """Check whether messages on the bus at `url` are signed, if others can send on it."""
    try:
        in_use = key_of(url)
    except ExpectedError as error:
        sentence, _, remedy = str(error).partition(". ")
        return Finding(RED, f"{sentence.rstrip('.')}.", remedy)
    if in_use is not None:
        return Finding(GREEN, f"Messages are signed by the key {shown(in_use)}; other computers need the same.")
    if is_shared(url):
        return Finding(AMBER, "Anybody on the network can drive the robots: --insecure.", "cmr key new")
    return Finding(GREEN, "There is no key, and the bus stays on this computer.")


def ports() -> Finding:
    """Look for serial ports."""
    from robot_driver.serial_port import available_ports

    found = available_ports()
    if found:
        return Finding(GREEN, f"Serial ports: {', '.join(found)}.")
    return Finding(AMBER, "There are no serial ports.", "For a real robot, plug its devices in; see with: ls /dev/tty*")


def permissions() -> Finding:
    """Check whether this user may open the serial ports."""
    from robot_driver.serial_port import available_ports

    closed = [port for port in available_ports() if not os.access(port, os.R_OK | os.W_OK)]
    if closed:
        return Finding(
            RED, f"You may not use {', '.join(closed)}.", "sudo usermod -aG dialout $USER, then log in again."
        )
    return Finding(GREEN, "You may use all serial ports.")


def clock() -> Finding:
    """Ask the kernel whether the time of day is synchronised."""
    synchronised = clock_synchronised()
    if synchronised is None:
        return Finding(AMBER, "The kernel does not say whether the clock is synchronised.", "See: timedatectl")
    if synchronised:
        return Finding(GREEN, "The clock is synchronised.")
    return Finding(
        AMBER,
        "The clock is not synchronised. Robots on several computers need clocks that agree within some milliseconds.",
        "sudo apt-get install chrony, or: sudo timedatectl set-ntp true",
    )


def clock_synchronised() -> bool | None:
    """Return the state from adjtimex(2); None if it is not available."""
    import ctypes

    try:
        state: int = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(512))  # all zero: only to read
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != TIME_ERROR


def real_time_priority() -> Finding:
    """Check whether this user's processes may use real-time priority, as cmr-driver does."""
    import resource

    allowed, _ = resource.getrlimit(resource.RLIMIT_RTPRIO) if hasattr(resource, "RLIMIT_RTPRIO") else (0, 0)
    if allowed != 0 or os.geteuid() == 0:
        return Finding(GREEN, "cmr-driver can have real-time priority.")
    return Finding(
        AMBER,
        "cmr-driver cannot have real-time priority; on a busy computer its commands come late.",
        "echo '@dialout - rtprio 1' | sudo tee /etc/security/limits.d/60-cmr.conf, then log in again.",
    )


def compiled_model() -> Finding:
    """Check whether everything that commands compile at their first use has been compiled."""
    from cmr.commands.first_use import PARTS, in_words, not_compiled, seconds_of

    missing = not_compiled(PARTS)
    if not missing:
        return Finding(GREEN, f"This computer has compiled {in_words(PARTS)}.")
    return Finding(
        AMBER,
        f"Not compiled yet: {in_words(missing)}. Commands that need these take up to {seconds_of(missing)} s longer "
        "the first time, on an idle computer.",
        "cmr demo compiles them all.",
    )


def cpu() -> Finding:
    """Measure the delay of this process after naps like cmr-driver's."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    latest = _latest_waking()
    load = os.getloadavg()[0]
    state = f"{cores} cores, load {load:.1f}; woke up at most {1e3 * latest:.1f} ms late."
    if latest > LATE:
        return Finding(RED, state, "This computer is too busy. End other programs; see which with: top")
    if cores < SECURE_CORES or load > cores:
        return Finding(AMBER, state, "Real robots want two cores and little else that runs; see with: top")
    return Finding(GREEN, state)


def _latest_waking() -> float:
    """Return the largest delay [s] of some naps."""
    latest = 0.0
    for _ in range(NAPS):
        due = time.monotonic() + NAP
        time.sleep(NAP)
        latest = max(latest, time.monotonic() - due)
    return latest


def _show(findings: dict[str, Finding]) -> None:
    try:
        _show_in_colour(findings)
    except ModuleNotFoundError:  # the driver alone does not include rich
        width = max(map(len, findings))
        for name, (colour, sentence, remedy) in findings.items():
            print(f"{colour:5}  {name:{width}}  {sentence}")
            if remedy:
                print(f"{'':5}  {'':{width}}  {remedy}")


def _show_in_colour(findings: dict[str, Finding]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    colours = {GREEN: "green", AMBER: "yellow", RED: "bold red"}
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, (colour, sentence, remedy) in findings.items():
        more = f"\n[bold]{escape(remedy)}[/]" if remedy else ""
        table.add_row(f"[{colours[colour]}]{colour}[/]", name, f"{escape(sentence)}{more}")
    Console(highlight=False).print(table)
