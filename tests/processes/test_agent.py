"""An agent runs on its machine what a run on another one asks for, and nothing else, and not for longer."""

import json
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.bus.messages import make
from cmr.msg import process_request_t
from cmr.processes.agent import LAPSE, Agent
from cmr.processes.job import DRIVER, EMULATOR, PILOT, Job
from cmr.processes.requests import RequestError, read_request, requests_of
from cmr.processes.supervisor import FIRST_DELAY
from tests.support.driver_bench import wait_for

HERE = socket.gethostname()
UTIME = 1_700_000_000_000_000


def job(name: str, folder: Path, *arguments: str, role: str = DRIVER, **more: Any) -> Job:
    return Job(name, role, ["/usr/bin/cmr-driver", *arguments, "--parameters", str(folder / "robot_0.yaml")], **more)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run on the machine that leads."""
    folder = tmp_path / "lab" / "line-1"
    folder.mkdir(parents=True)
    (folder / "robot_0.yaml").write_text("k1: 0.1\n")
    (folder / "robot_1.yaml").write_text("k1: 0.2\n")
    return folder


@pytest.fixture
def agent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Agent]:
    """An agent whose programs all sleep."""
    program = tmp_path / "program"
    program.write_text(f"#!{sys.executable}\nimport sys, time\nprint(sys.argv[1:], flush=True)\ntime.sleep(60)\n")
    program.chmod(0o755)
    monkeypatch.setattr("cmr.processes.requests.our_command", lambda _name: str(program))
    result = Agent(tmp_path / "robot")
    yield result
    result.stop()


def ask(agent: Agent, jobs: list[Job], run: Path, now: float, wanted: bool = True) -> None:
    for request in requests_of(jobs, run, UTIME, wanted):
        agent.handle(UTIME, "PROCESS_REQUEST", request, now)
    agent.poll(now)


def test_a_process_gets_its_files_and_its_folder_and_runs_until_the_run_ends(
    agent: Agent, run: Path, tmp_path: Path
) -> None:
    wanted = [job("driver 0", run, "--port", "/dev/motor", host=HERE)]
    ask(agent, wanted, run, 0.0)
    ask(agent, wanted, run, 1.0)
    state = agent.states["driver 0"]
    there = tmp_path / "robot" / "line-1"
    assert (state.starts, agent.sentence) == (1, "line-1: driver 0 runs.")
    assert {path.name for path in there.glob("*.yaml")} == {"robot_0.yaml"}
    wait_for(lambda: (there / "driver_0.txt").read_text())
    said = (there / "driver_0.txt").read_text()
    assert said == f"{['--port', '/dev/motor', '--parameters', str(there / 'robot_0.yaml')]}\n"
    ask(agent, wanted, run, 2.0, wanted=False)
    assert agent.sentence == "Serves no run."
    assert not _is_alive(state.pid)


def test_what_dies_is_started_again_and_what_changed_its_file_keeps_it(agent: Agent, run: Path, tmp_path: Path) -> None:
    wanted = [job("driver 0", run, host=HERE)]
    ask(agent, wanted, run, 0.0)
    file = tmp_path / "robot" / "line-1" / "robot_0.yaml"
    file.write_text("k1: 0.3\n")
    agent._children._running["driver 0"].kill()
    wait_for(lambda: not agent._children.is_running("driver 0"))
    assert "was ended by SIGKILL" in agent.poll(1.0)[0]
    assert agent.down == ["driver 0"]
    ask(agent, wanted, run, 1.0 + FIRST_DELAY)
    assert agent.states["driver 0"].starts == 2
    assert file.read_text() == "k1: 0.3\n"


def test_a_pilot_that_would_begin_its_drive_again_does_not(agent: Agent, run: Path) -> None:
    ask(agent, [job("pilot 0", run, role=PILOT, host=HERE, once=True)], run, 0.0)
    agent._children._running["pilot 0"].kill()
    wait_for(lambda: not agent._children.is_running("pilot 0"))
    agent.poll(1.0)
    agent.poll(1.0 + FIRST_DELAY)
    assert agent.states["pilot 0"].starts == 1


def test_when_nothing_is_heard_of_the_run_all_is_stopped_and_another_one_served(agent: Agent, run: Path) -> None:
    wanted = [job("driver 0", run, host=HERE)]
    ask(agent, wanted, run, 0.0)
    pid = agent.states["driver 0"].pid
    other = run.parent / "line-2"
    ask(agent, wanted, other, 1.0)
    assert agent.sentence == "line-1: driver 0 runs. Not started: driver 0 of line-2: this machine serves line-1."
    assert agent.poll(LAPSE) == []
    assert "Nothing was heard of line-1" in agent.poll(LAPSE + 0.1)[0]
    assert not _is_alive(pid)
    ask(agent, wanted, other, LAPSE + 1.0)
    assert agent.sentence == "line-2: driver 0 runs."


def test_what_is_for_another_machine_is_left_to_it(agent: Agent, run: Path) -> None:
    ask(agent, [job("driver 0", run, host="another")], run, 0.0)
    assert not agent.states


def test_an_emulators_driver_waits_for_its_port(agent: Agent, run: Path, tmp_path: Path) -> None:
    emulator = Job("emulator 0", EMULATOR, ["cmr-emulate", "--ports", str(run / "ports_0")], host=HERE)
    ask(agent, [emulator, job("driver 0", run, host=HERE, after=run / "ports_0" / "gyro")], run, 0.0)
    assert [state.starts for state in agent.states.values()] == [1, 0]
    port = tmp_path / "robot" / "line-1" / "ports_0" / "gyro"
    port.parent.mkdir()
    port.touch()
    agent.poll(1.0)
    assert [state.starts for state in agent.states.values()] == [1, 1]


GOOD = {
    **{"utime": UTIME, "wanted": True, "once": False, "host": HERE, "run": "line-1", "name": "driver 0"},
    **{"role": DRIVER, "command": '["cmr-driver"]', "after": "", "files": "{}"},
}


@pytest.mark.parametrize(
    "wrong",
    [
        {"command": '["/bin/sh", "-c", "true"]'},
        {"command": '["../../bin/sh"]'},
        {"command": "[]"},
        {"command": '["cmr-driver", 7]'},
        {"command": "{"},
        {"command": "[" * 100_000},
        {"command": json.dumps(["cmr-driver"] * 1000)},
        {"files": '{"../key.yaml": "x"}'},
        {"files": '{".bashrc": "x"}'},
        {"files": '{"a.yaml": 7}'},
        {"files": "[]"},
        {"run": "../line"},
        {"run": ""},
        {"run": "."},
        {"role": "root"},
        {"name": ""},
        {"name": "../driver 0"},
        {"name": "d" * 300},
        {"name": "driver\0"},
        {"command": json.dumps(["cmr-driver", "a\0b"])},
        {"command": '["cmr-driver", "\\ud800"]'},
        {"command": json.dumps(["cmr-driver", "x" * 200_000])},
        {"files": '{"a.yaml": "\\ud800"}'},
        {"after": "{run}/" + "x" * 300},
        {"after": "a\0b"},
    ],
    ids=str,
)
def test_what_is_no_request_of_a_run_starts_nothing_and_writes_nothing(
    agent: Agent, tmp_path: Path, wrong: dict[str, str]
) -> None:
    message = make(process_request_t, **{**GOOD, **wrong})
    with pytest.raises(RequestError):
        read_request(message, tmp_path)
    agent.handle(UTIME, "PROCESS_REQUEST", message, 0.0)
    agent.poll(0.0)
    assert not agent.states
    assert agent.refused
    assert not (tmp_path / "robot").exists()


def test_a_program_that_is_not_installed_is_refused_and_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cmr.processes.requests.our_command", lambda name: f"/nowhere/{name}")
    agent = Agent(tmp_path / "robot")
    agent.handle(UTIME, "PROCESS_REQUEST", make(process_request_t, **GOOD), 0.0)
    agent.poll(0.0)
    assert agent.refused == "driver 0 of line-1: cmr-driver is not installed on this computer"


@given(st.dictionaries(st.sampled_from(["run", "name", "role", "command", "after", "files"]), st.text(max_size=30)))
def test_no_text_of_a_request_raises_anything_else(texts: dict[str, str]) -> None:
    try:
        request = read_request(make(process_request_t, **{**GOOD, **texts}), Path("/nowhere"))
    except RequestError:
        return
    assert request.folder.parent == Path("/nowhere")


def test_what_the_system_refuses_is_reported_and_leaves_the_agent_alive(
    agent: Agent, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "robot").touch()  # so that no folder can be made
    ask(agent, [job("driver 0", run, host=HERE)], run, 0.0)
    assert (list(agent.states), "driver 0 of line-1" in agent.refused) == ([], True)
    (tmp_path / "robot").unlink()
    with monkeypatch.context() as full:
        full.setattr("subprocess.Popen", refuse)
        ask(agent, [job("driver 0", run, host=HERE)], run, 1.0)
    assert "no process more" in agent.refused
    agent.poll(2.0)
    assert agent.states["driver 0"].starts == 1


def refuse(*_arguments: Any, **_options: Any) -> None:
    raise OSError("no process more")


def _is_alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()
