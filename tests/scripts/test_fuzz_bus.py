"""scripts/fuzz_bus knows all subscriptions, its checks find faulty processes, and processes withstand its messages."""

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import make
from cmr.bus.streams import ESTOP, MOTOR_COMMAND, POSE
from cmr.msg import estop_t, motor_command_t, pose_xyt_t
from tests.support.project import PROJECT

pytestmark = pytest.mark.slow

sys.path.insert(0, str(PROJECT / "scripts"))
coverage: Any = importlib.import_module("fuzzing.subscriptions")
draws: Any = importlib.import_module("fuzzing.draws")
duties: Any = importlib.import_module("fuzzing.duties")
messages: Any = importlib.import_module("fuzzing.messages")
programs: Any = importlib.import_module("fuzzing.programs")

UTIME = 1_800_000_000_000_000
BAD = """
import sys
from cmr.bus.process import Process
from cmr.bus.streams import POSE

def main(arguments):
    kind = arguments[0]
    def handle(utime, channel, message):
        if kind == "death":
            raise ValueError("of a message")
        if kind == "hang":
            sum(k * k for k in range(20_000_000))
        if kind == "publication":
            message.x = float("nan")
            process.publish(POSE, message, 1)
        if kind == "end":
            process.stopped_by_signal = True
    with Process("bad", "memq://fuzz") as process:
        process.subscribe(POSE, 0, every=True)
        for _ in process.loop(100.0):
            process.dispatch(handle, gated=True)
    return process.exit_code
"""
RUNS = """
import sys
from pathlib import Path
from cmr.bus.messages import make
from cmr.msg import pose_xyt_t
from fuzzing.process_run import ProcessRun
from fuzzing.programs import Program

for kind in ("good", "death", "hang", "publication", "end"):
    run = ProcessRun(Program("cmr.bad_process_of_a_test", lambda at: [kind]), Path(sys.argv[1]), None)
    run.begin()
    heard = list(run.subscribed_streams())
    pose = make(pose_xyt_t, utime=run.utime, robot_id=0, x=0.0, y=0.0, theta=0.0)
    run.deliver("POSE_0", pose.encode())
    run.advance(0.1)
    run.end()
    print(kind, heard, [finding.kind for finding in run.found], flush=True)
"""


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (PROJECT / "scripts", PROJECT)))}


def test_each_file_that_subscribes_belongs_to_a_process_that_is_fuzzed() -> None:
    subscribing = {name for name, _line in coverage.subscribe_calls(PROJECT)}
    assert len(subscribing) > 12
    known = {name for program in programs.PROGRAMS.values() for name in program.files}
    assert subscribing == known


def test_a_process_is_seen_to_subscribe_where_the_code_says_so(tmp_path: Path) -> None:
    command = [sys.executable, str(PROJECT / "scripts/fuzzing/bus_target.py"), "agent", "?", "0", str(tmp_path)]
    noted = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert noted["streams"] == ["PROCESS_REQUEST", "PROCESS_STATUS"]
    lines = {line for name, line in coverage.subscribe_calls(PROJECT) if name == "cmr/commands/agent.py"}
    made = {line for name, line in noted["places"] if name == "cmr/commands/agent.py"}
    assert made == lines


@pytest.mark.waits  # the processes that are fuzzed must answer within a minute
def test_some_pairs_for_a_second_each(tmp_path: Path) -> None:
    for process, streams in (("agent", "PROCESS_REQUEST"), ("relay", "POSE,WORLD_STATE")):
        command = [sys.executable, str(PROJECT / "scripts/fuzzing/bus_target.py"), process, streams, "1", str(tmp_path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        found = "".join(path.read_text() for path in tmp_path.glob("*/found.txt"))
        assert (done.returncode, found) == (0, ""), done.stderr
        for stream in streams.split(","):
            result = json.loads((tmp_path / stream / "result.json").read_text())
            assert result["executions"] > 0


def test_a_life_that_ends_hangs_or_says_what_cannot_be_is_found(tmp_path: Path) -> None:
    (tmp_path / "cmr_bad.py").write_text(BAD)
    load = "import sys, importlib.util as u; s = u.spec_from_file_location('cmr.bad_process_of_a_test', sys.argv[1] + "
    load += "'/cmr_bad.py'); m = u.module_from_spec(s); sys.modules[s.name] = m; s.loader.exec_module(m)\n"
    command = [sys.executable, "-c", load + RUNS, str(tmp_path)]
    said = subprocess.run(command, capture_output=True, text=True, env=environment(), check=True).stdout.splitlines()
    assert said == [
        "good ['POSE'] []",
        "death ['POSE'] ['death']",
        "hang ['POSE'] ['hang']",
        "publication ['POSE'] ['publication']",
        "end ['POSE'] ['death']",
    ]


def test_duties_that_nobody_commanded_are_found() -> None:
    now = [0.0, 0.0]
    checks = duties.DutyChecks("MOTOR_COMMAND_0", lambda: now)
    assert checks.problem(UTIME) == ""
    now[:] = [0.3, 0.1]
    assert checks.problem(UTIME)
    command = make(motor_command_t, utime=UTIME, robot_id=0, left=0.3, right=-0.3)
    checks.sent(MOTOR_COMMAND.channel(0), command.encode(), UTIME)
    assert checks.problem(UTIME + 500_000) == ""
    assert checks.problem(UTIME + 700_000)
    checks.sent(MOTOR_COMMAND.channel(0), command.encode(), UTIME + 700_000)
    stop = make(estop_t, utime=UTIME, engaged=True, source="", reason="")
    checks.sent(ESTOP.name, stop.encode(), UTIME + 700_000)
    assert checks.problem(UTIME + 800_000) == ""
    assert checks.problem(UTIME + 900_000)


def test_the_same_bytes_make_the_same_message_and_some_are_right() -> None:
    made = [messages.fuzzed(draws.Draws(bytes([kind] * 60)), POSE, 0, UTIME) for kind in range(10)]
    assert made == [messages.fuzzed(draws.Draws(bytes([kind] * 60)), POSE, 0, UTIME) for kind in range(10)]
    assert len(set(made)) > 5
    assert pose_xyt_t.decode(messages.fuzzed(draws.Draws(b""), POSE, 0, UTIME)).utime == UTIME
