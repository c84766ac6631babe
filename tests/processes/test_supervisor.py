"""What dies is started again where that is safe, later each time; everything is stopped in order."""

import os
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cmr.processes.children import Children
from cmr.processes.job import DRIVER, PILOT, RECORDER, SIM, Job
from cmr.processes.supervisor import FIRST_DELAY, MOST_ENDS, PROVEN, Supervisor

pytestmark = pytest.mark.waits

LIVE = "import time; print('here'); time.sleep(60)"
FAIL = "import sys; print('no port'); sys.exit(1)"
# Writes its name and when it was asked to end, then ends.
ENDING = """
import signal, sys, time
def end(*_):
    open(sys.argv[1], "a").write(sys.argv[2] + chr(10))
    time.sleep(0.05)
    sys.exit(130)
signal.signal(signal.SIGTERM, end)
print("here", flush=True)
time.sleep(60)
"""


def job(role: str, source: str, *arguments: str, name: str = "", once: bool = False, after: Path | None = None) -> Job:
    return Job(name or role, role, [sys.executable, "-S", "-c", source, *arguments], 0, after=after, once=once)


@pytest.fixture
def children(tmp_path: Path) -> Iterator[Children]:
    with Children(tmp_path) as result:
        yield result


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def end_of(supervisor: Supervisor, name: str, now: float) -> str:
    """Wait until a process has ended, and return what the supervisor says of it."""
    until(lambda: not supervisor.is_running(name))
    (sentence,) = supervisor.poll(now)
    return sentence


def kill(supervisor: Supervisor, name: str, number: int = 9) -> None:
    until(lambda: bool(supervisor.last_words(name)) or number == 9)
    os.kill(supervisor.states[name].pid, number)


@pytest.mark.parametrize("role", [RECORDER, SIM, DRIVER, PILOT])
def test_what_is_killed_is_started_again(role: str, children: Children) -> None:
    supervisor = Supervisor([job(role, LIVE)], children)
    assert supervisor.poll(0.0) == []
    first = supervisor.states[role].pid
    kill(supervisor, role)
    assert "SIGKILL" in end_of(supervisor, role, 10.0)
    supervisor.poll(10.0 + 0.9 * FIRST_DELAY)
    assert not supervisor.is_running(role)
    supervisor.poll(10.0 + 1.1 * FIRST_DELAY)
    assert supervisor.is_running(role)
    assert supervisor.states[role].pid != first
    assert supervisor.restarts == 1


def test_each_restart_waits_twice_as_long_until_the_process_has_proved_itself(children: Children) -> None:
    supervisor = Supervisor([job(DRIVER, FAIL)], children)
    now, delays = 0.0, []
    for lived in (0.0, 0.0, 0.0, 0.0, 1.1 * PROVEN):
        supervisor.poll(now)
        now += lived
        assert "no port" in end_of(supervisor, DRIVER, now)
        due = supervisor.states[DRIVER].due
        assert due is not None
        delays.append(due - now)
        now = due
    assert delays == pytest.approx([FIRST_DELAY * factor for factor in (1, 2, 4, 8, 1)])


def test_a_driver_or_pilot_that_held_its_robot_stays_down(children: Children) -> None:
    jobs = [job(DRIVER, LIVE), job(PILOT, LIVE), job(SIM, LIVE)]
    supervisor = Supervisor(jobs, children, held=lambda _pid: True)
    supervisor.poll(0.0)
    for role in (DRIVER, PILOT):
        kill(supervisor, role)
        assert "the robot stays still" in end_of(supervisor, role, 1.0)
    kill(supervisor, SIM)
    assert "Started again" in end_of(supervisor, SIM, 1.0)
    assert supervisor.given_up() == [DRIVER, PILOT]


def test_a_drive_is_never_begun_anew(children: Children) -> None:
    """A pilot that ended its drive with a complaint, or drove without looking where it is, would move the robot."""
    supervisor = Supervisor([job(PILOT, FAIL), job(PILOT, LIVE, name="blind", once=True)], children)
    supervisor.poll(0.0)
    assert "the robot stays still" in end_of(supervisor, PILOT, 1.0)
    kill(supervisor, "blind")
    assert "the robot stays still" in end_of(supervisor, "blind", 1.0)
    supervisor.poll(1000.0)
    assert supervisor.given_up() == [PILOT, "blind"]


def test_what_somebody_ended_stays_ended(children: Children) -> None:
    supervisor = Supervisor([job(DRIVER, LIVE)], children)
    supervisor.poll(0.0)
    kill(supervisor, DRIVER, 15)
    assert "Somebody ended it" in end_of(supervisor, DRIVER, 1.0)


def test_what_is_done_is_done(children: Children) -> None:
    supervisor = Supervisor([job(PILOT, "print('over')")], children)
    supervisor.poll(0.0)
    assert "It is done" in end_of(supervisor, PILOT, 1.0)
    assert supervisor.is_done(PILOT)
    assert not supervisor.given_up()


def test_a_process_waits_for_the_file_that_it_needs(children: Children, tmp_path: Path) -> None:
    supervisor = Supervisor([job(DRIVER, LIVE, after=tmp_path / "port")], children)
    supervisor.poll(0.0)
    assert supervisor.states[DRIVER].starts == 0
    (tmp_path / "port").touch()
    supervisor.poll(0.1)
    assert supervisor.is_running(DRIVER)


def test_pilots_stop_first_then_the_world_then_drivers_and_the_recorder_last(
    children: Children, tmp_path: Path
) -> None:
    order = tmp_path / "order"
    roles = (RECORDER, DRIVER, SIM, PILOT)
    supervisor = Supervisor([job(role, ENDING, str(order), role) for role in roles], children)
    supervisor.poll(0.0)
    until(lambda: all(supervisor.last_words(role) for role in roles))
    supervisor.stop()
    assert order.read_text().split() == [PILOT, SIM, DRIVER, RECORDER]
    assert not any(supervisor.is_running(role) for role in roles)
    assert supervisor.poll(1000.0) == []


def test_it_is_asked_for_what_a_process_needs_before_each_start(children: Children) -> None:
    prepared: list[str] = []
    supervisor = Supervisor([job(SIM, FAIL)], children, prepare=lambda job: prepared.append(job.name))
    supervisor.poll(0.0)
    end_of(supervisor, SIM, 1.0)
    supervisor.poll(100.0)
    assert prepared == [SIM, SIM]


def test_what_may_not_start_yet_waits(children: Children) -> None:
    driver_is_there = False
    jobs = [job(DRIVER, LIVE), job(PILOT, LIVE)]
    supervisor = Supervisor(jobs, children, may_start=lambda one: one.role == DRIVER or driver_is_there)
    supervisor.poll(0.0)
    assert supervisor.is_running(DRIVER)
    assert not supervisor.is_running(PILOT)
    driver_is_there = True
    supervisor.poll(0.1)
    assert supervisor.is_running(PILOT)


def test_of_a_process_that_says_and_ends_ever_more_little_is_kept_and_read(children: Children) -> None:
    noisy = "import sys; print('x' * 100 + chr(10)); print('no port'); sys.exit(1)"
    supervisor = Supervisor([job(DRIVER, noisy)], children)
    state = supervisor.states[DRIVER]
    state.ends = ["ended before"] * MOST_ENDS
    supervisor.poll(0.0)
    assert "no port" in end_of(supervisor, DRIVER, 1.0)
    assert len(state.ends) == MOST_ENDS
    assert state.ends[-1] == "ended with exit code 1"
    with (children.folder / f"{DRIVER}.txt").open("ab") as said:
        said.write(b"line\n" * 1_000_000 + b"the last\n")
    tracemalloc.start()
    assert children.last_words(DRIVER) == "the last"
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()
