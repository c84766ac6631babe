"""cmr-agent: run processes of experiments that another computer leads."""

import argparse
import time
from pathlib import Path

from cmr.bus.preflight import key_of, resolve_url
from cmr.bus.process import Process
from cmr.bus.streams import PROCESS_REQUEST, PROCESS_STATUS
from cmr.cli.command_line import check_writable, parser
from cmr.cli.configuration import is_insecure, results
from cmr.cli.errors import CommandError
from cmr.msg import process_status_t
from cmr.processes.agent import Agent
from cmr.processes.requests import AGENT

RATE = 20.0  # Hz


def main(arguments: list[str]) -> int:
    """Run cmr-agent.

    Raises CommandError where there is no key, BusError when the bus cannot be used.
    """
    options = command_parser().parse_args(arguments)
    if key_of(resolve_url(options.lcm_url)) is None and not is_insecure():
        raise CommandError(
            "An agent starts whatever is requested, so it needs a key: cmr key. Or start with --insecure."
        )
    check_writable(options.out)
    agent = Agent(options.out)
    with Process(AGENT, options.lcm_url) as process:
        process.subscribe(PROCESS_REQUEST, every=True)
        process.subscribe(PROCESS_STATUS, every=True)
        try:
            for _ in process.loop(RATE):
                for received in process.received():
                    agent.handle(received.message.utime, received.channel, received.message, time.monotonic())
                for sentence in agent.poll(time.monotonic()):
                    process.news(sentence)
                process.state = process_status_t.DEGRADED if agent.down else process_status_t.RUNNING
                process.message = agent.sentence
        finally:
            agent.stop()
        return process.exit_code


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr agent."""
    result = parser(
        "cmr-agent",
        "Run what experiments need on this computer, such as the driver and the pilot of a robot: cmr-run on another "
        "computer requests it if the scenario names this host. Processes are restarted as in cmr-run. All are "
        "stopped when the run ends, when cmr-run was silent for 5 s, and when the agent ends.\n\nAnybody with the "
        "key can start CMR's own programs here, with any options, as the user of the agent.",
        "cmr-agent --out experiments",
    )
    result.add_argument(
        "--out", type=Path, default=results() / "agent", metavar="DIR", help="folder in which each run gets a subfolder"
    )
    return result
