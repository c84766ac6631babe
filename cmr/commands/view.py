"""cmr-view: the world in a web page, live or from a log."""

import argparse
import secrets
import ssl
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from cmr.bus.messages import now_utime
from cmr.bus.process import Process
from cmr.bus.streams import ESTOP, ESTOP_LATCH
from cmr.cli.command_line import add_logs, logs_of, parser
from cmr.cli.errors import CommandError
from cmr.distribution import how_to_install
from cmr.geometry.obstacles import Geofence, ObstacleError, Obstacles
from cmr.msg import process_status_t
from cmr.processes.children import our_command

if TYPE_CHECKING:
    from cmr.view.server import PageServer
    from cmr.view.showing import Showing

RATE = 20.0  # Hz
LOCAL = "127.0.0.1"
SHORTEST_TOKEN = 8  # characters


def main(arguments: list[str]) -> int:
    """Run cmr-view."""
    options = command_parser().parse_args(arguments)
    options.log = next(iter(logs_of(options)), None)
    _check(options)
    obstacles, geofence = _room(options)
    tls = _encryption(options)
    try:
        from cmr.view.driving import DriveSessions
        from cmr.view.entrance.door import Address
        from cmr.view.guiding import GuideSessions
        from cmr.view.server import MakeBeside, PageServer
        from cmr.view.showing import LiveShowing, LogShowing
        from cmr.view.visit import Room
    except ModuleNotFoundError as error:
        raise CommandError(f"{error.name} is missing. To install it: {how_to_install('view')}") from error
    token = options.token or secrets.token_urlsafe(12)
    with Process("cmr-view", options.lcm_url) as process:
        process.subscribe(ESTOP, every=True)
        process.subscribe(ESTOP_LATCH, every=True)
        try:
            showing: Showing = LogShowing(options.log) if options.log else LiveShowing(options.lcm_url)
            address = Address(options.host, options.port, tuple(options.allow_host or ()), tls)
            drive, guide = _driving(process.bus.url, geofence), _bringing_up(process.bus.url, options.ports or ())
            beside: list[MakeBeside] = [partial(DriveSessions, drive), partial(GuideSessions, guide)]
            server = PageServer(address, token, Room(obstacles, geofence), showing, [] if options.log else beside)
        except OSError as error:
            raise CommandError(f"{options.log or options.host}: {error.strerror or error}") from error
        print(f"cmr-view: {server.url}  token for its buttons: {token}", file=sys.stderr, flush=True)
        try:
            _serve(process, server, showing)
        finally:
            server.stop()
        return process.exit_code


def _serve(process: Process, server: "PageServer", showing: "Showing") -> None:
    """Show the world and fulfil visitors' requests until the process ends."""
    for utime in process.loop(rate_hz=RATE):
        process.dispatch(showing.orders.handle)
        showing.advance(1.0 / RATE)
        for request in server.requested(utime):
            showing.fulfil(request, utime)
        process.publish_all(showing.orders.due(now_utime()))
        server.show(1.0 / RATE)
        if news := server.refusals.news():
            process.news(news)
        process.state = process_status_t.RUNNING
        process.message = f"{showing.message()} {server.refusals.latest}".strip()


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-view."""
    options = parser(
        "cmr-view",
        "Show the world in a web page: robots, twins, trails, processes and bus, calibration and diagnosis, plots of "
        "any signal; live from the bus, or from a log with a time slider. A log that is dropped on the page is "
        "played for that visitor alone.\n\nThe buttons work after you enter the token that is printed at the start. "
        "The emergency stop and opening a log need no token while the page is served to this computer alone; "
        "releasing the stop always does. The page is served to this computer alone, unless --host and --token are "
        "given. Browsers must use localhost, an address of this computer, or a name given by --host or --allow-host.",
        "cmr-view run.lcm\n  cmr-view\n  cmr-view --host 0.0.0.0 --token 'a secret of ours' --scenario swarm\n"
        "  cmr-view --host 0.0.0.0 --token 'a secret of ours' --certificate lab.pem --key lab.key "
        "--allow-host robots.lab",
    )
    add_logs(options, "a log to play; without it, the bus", single=True)
    options.add_argument("--host", default=LOCAL, metavar="ADDRESS", help="to serve at; others than this need --token")
    options.add_argument("--port", type=_port, default=8080, metavar="N", help="to serve at, or the next that is free")
    options.add_argument(
        "--allow-host", action="append", metavar="NAME", help="by which browsers may call this computer; needs --token"
    )
    options.add_argument("--certificate", metavar="FILE", help="PEM: encrypts the page (https), with its --key")
    options.add_argument("--key", metavar="FILE", help="PEM: the private key, if it is not in the certificate's file")
    options.add_argument("--token", metavar="TEXT", help="for the buttons; without it a new one at each start")
    options.add_argument("--ports", nargs="+", metavar="DEVICE", help="serial ports of robots to bring up; else all")
    options.add_argument("--scenario", metavar="FILE", help="or name, as of cmr-run: its obstacles and geofence")
    for name, form, what in (
        ("--obstacle", "X,Y,RADIUS", "a disc"),
        ("--wall", "X1,Y1,X2,Y2", "a straight wall"),
        ("--geofence", "X1,Y1,X2,Y2,...", "the polygon that robots stay inside of"),
    ):
        action = "store" if name == "--geofence" else "append"
        options.add_argument(name, type=_numbers, action=action, metavar=form, help=f"{what} [m] to draw")
    return options


def _check(options: argparse.Namespace) -> None:
    if options.token is not None and len(options.token) < SHORTEST_TOKEN:
        raise CommandError(f"--token is too short; give one of {SHORTEST_TOKEN} characters or more.")
    if options.host not in (LOCAL, "localhost") and options.token is None:
        raise CommandError(f"--host {options.host} lets others see the page; give the buttons' --token, too.")
    if options.allow_host and options.token is None:
        raise CommandError("--allow-host lets others see the page; give the buttons' --token, too.")


def _driving(url: str, geofence: Geofence | None) -> Callable[[int, bool], list[str]]:
    """Return a function that makes the command of cmr-teleop for a visitor's robot, with or without taking it over."""
    limits = []
    if geofence is not None:
        limits = [f"--geofence={','.join(f'{number:g}' for number in geofence.outline.T.ravel())}"]

    def command(robot_id: int, takes_over: bool) -> list[str]:
        teleop = [our_command("cmr"), "teleop", "--page", "--robot", str(robot_id), "--lcm-url", url]
        return [*teleop, *limits, *["--take-over"] * takes_over]

    return command


def _bringing_up(url: str, ports: Sequence[str]) -> Callable[[int, Sequence[str]], list[str]]:
    """Return a function that makes the command of cmr bringup for a robot and some of its steps, or all."""

    def command(robot_id: int, steps: Sequence[str]) -> list[str]:
        bringup = [our_command("cmr"), "bringup", *steps, "--page", "--robot", str(robot_id), "--lcm-url", url]
        return [*bringup, *(["--ports", *ports] if ports else [])]

    return command


def _encryption(options: argparse.Namespace) -> ssl.SSLContext | None:
    """Return the page's TLS context, if requested. Raises CommandError for invalid files."""
    if options.certificate is None:
        if options.key is not None:
            raise CommandError("--key is of no use without --certificate.")
        return None
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        # No password is asked for: nobody may be there to type it.
        context.load_cert_chain(options.certificate, options.key, password=lambda: "")
    except (OSError, ValueError) as error:  # SSLError is an OSError
        reason = error.strerror if isinstance(error, OSError) and not isinstance(error, ssl.SSLError) else ""
        raise CommandError(
            f"--certificate, --key: {reason or 'they do not fit together, or are no PEM files without a password'}."
        ) from error
    return context


def _room(options: argparse.Namespace) -> tuple[Obstacles, Geofence | None]:
    """Return the fixed objects from the command line and the scenario. Raises CommandError for invalid ones."""
    obstacles, geofence = Obstacles.none(), None
    if options.scenario:
        obstacles, geofence = _room_of(options.scenario)
    try:
        discs, walls = [*(options.obstacle or ()), *obstacles.discs.T], [*(options.wall or ()), *obstacles.walls.T]
        if options.geofence:
            geofence = Geofence(_pairs(options.geofence))
        return Obstacles(discs, walls), geofence
    except (ObstacleError, ValueError) as error:
        raise CommandError(f"--obstacle, --wall, --geofence: {error}") from error


def _room_of(path: str) -> tuple[Obstacles, Geofence | None]:
    from cmr.commands.scenarios import load
    from cmr.experiments.scenario import ScenarioError
    from cmr.experiments.scenario.reading import path_of

    try:
        scenario = load(path_of(path), starts_checked=False)
    except ScenarioError as error:
        raise CommandError(str(error)) from error
    return scenario.obstacles, scenario.fence


def _pairs(numbers: Sequence[float]) -> list[tuple[float, float]]:
    if len(numbers) % 2:
        raise ValueError(f"{len(numbers)} numbers are no points of x and y")
    return list(zip(numbers[::2], numbers[1::2], strict=True))


def _numbers(text: str) -> list[float]:
    return [float(number) for number in text.split(",")]


def _port(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 0 < int(text) < 65536):
        raise argparse.ArgumentTypeError(f"{text!r} is not a port: a whole number of 1 to 65535")
    return int(text)
