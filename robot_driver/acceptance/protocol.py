"""The whole protocol: the order of steps, and the report."""

import platform
import socket
import time
from collections.abc import Callable, Collection

from cmr.distribution import version
from robot_driver.acceptance import direct, ends, on_the_line, power
from robot_driver.acceptance.bench import Bench, Setup
from robot_driver.acceptance.findings import PROMISES, Finding
from robot_driver.acceptance.held_up import HeldUp
from robot_driver.acceptance.report import Report
from robot_driver.acceptance.running import Pace, Run
from robot_driver.controllers import CONTROLLERS, BadReply
from robot_driver.guided import Guide
from robot_driver.serial_port import PortLost, SerialPort

SESSIONS: tuple[Callable[[Run], None], ...] = (
    on_the_line.session,
    ends.session,
    power.session,
    power.slow_line,
    direct.session,
)
WITHOUT_FILTER = 10, 11, 12  # promises that need no filter
NO_DIALECT = "the filter does not speak the language of this controller"
LEFT_OUT = {
    8: ("a stop of the controller's own", "it can only be provoked at the controller"),
    9: ("an exception", "there is no way to cause one from outside"),
}
ATTEMPTS = 10  # to read the name of a device


def run_protocol(
    setup: Setup,
    front: Callable[[Callable[[float], None]], Guide],
    *,
    pace: Pace,
    wanted: Collection[int] = tuple(PROMISES),
    hands: bool = True,
) -> Report:
    """Perform all steps, and return the report. `front` makes the guide, given a function that waits.

    Raises Ended if a person ends it, PortLost if a port cannot be used.
    """
    device = name_of(setup)
    bench = Bench(setup)
    guide = front(lambda seconds: wait(bench, seconds))
    held_up = HeldUp()
    run = Run(bench, guide, pace, wanted, hands, held_up)
    bench.look = run.look
    begun = time.time()
    try:
        with held_up:
            for session in SESSIONS:
                if setup.dialect is not None or session is direct.session:
                    session(run)
    finally:
        bench.end()
    run.findings += not_tried(run)
    return _report(device, setup, run, begun)


def _report(device: str, setup: Setup, run: Run, begun: float) -> Report:
    """Return the report of a run that began at this time [s since the Unix epoch] and ends now."""
    return Report(
        device=device,
        controller=setup.settings.controller,
        gyro=setup.settings.gyro or ("dsp3000" if setup.settings.gyro_port else ""),
        port=setup.settings.port,
        host=socket.gethostname(),
        kernel=platform.platform(),
        python=platform.python_version(),
        cmr=version(),
        utime=round(1e6 * begun),
        seconds=time.time() - begun,
        short=run.pace.is_short,
        duty=setup.duty,
        figures={**run.figures, "steps_repeated": run.repeated},
        findings=tuple(sorted(run.findings, key=lambda one: one.promise)),
    )


def wait(bench: Bench, seconds: float) -> None:
    """Let time pass while a person thinks; a running driver gets the command zero."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        bench.turn((0.0, 0.0) if bench.process is not None else None, look=False)


def name_of(setup: Setup) -> str:
    """Return the name and firmware that the device reports. Raises PortLost."""
    settings = setup.settings
    kind = CONTROLLERS[settings.controller]
    if kind.streams:
        return settings.controller
    port = SerialPort(settings.port, settings.baud or kind.default_baud_rate)
    port.open()
    try:
        for _ in range(ATTEMPTS):
            try:
                port.resynchronise()
                return port.exchange(kind().identify()).value
            except BadReply:
                continue
    finally:
        port.close()
    raise PortLost(f"No {settings.controller} answers at {settings.port}: cmr-driver --list-devices shows what does.")


def not_tried(run: Run) -> list[Finding]:
    """Return the requested promises that were not tried, with reasons."""
    result = [Finding(number, check, None, why) for number, (check, why) in LEFT_OUT.items() if run.wants(number)]
    tried = {finding.promise for finding in run.findings}
    why = NO_DIALECT if run.bench.setup.dialect is None else "the protocol did not reach it"
    return result + [Finding(number, "", None, why) for number in PROMISES if run.wants(number) and number not in tried]
