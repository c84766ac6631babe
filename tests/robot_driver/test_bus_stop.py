"""The latched emergency stop of a driver: who engages it, who releases it, and what is reported of it."""

from pathlib import Path

import pytest

from cmr.bus.messages import make
from cmr.msg import estop_t
from robot_driver.bus_stop import REPORT_PERIOD, BusStop
from robot_driver.command_gate import CommandGate, Stop
from robot_driver.stop_file import EngagedStop, StopFile, StopKeeper
from tests.support.driver_bench import wait_for

NOW = 1_700_000_000_000_000  # us
SECOND = 1_000_000  # us
URL = "udpm://239.255.76.67:7667?ttl=0"


def estop(utime: int, engaged: bool, source: str = "Ada", reason: str = "smoke") -> estop_t:
    return make(estop_t, utime=utime, engaged=engaged, source=source, reason=reason)


def take(stop: BusStop, utime: int, engaged: bool, source: str = "Ada", reason: str = "smoke") -> None:
    stop.handle(estop(utime, engaged, source, reason), utime, utime=utime)


def is_held(gate: CommandGate) -> bool:
    return Stop.BUS in gate._stops


@pytest.fixture
def gate() -> CommandGate:
    return CommandGate()


def test_the_first_who_engages_it_is_named_until_it_is_released(gate: CommandGate) -> None:
    stop = BusStop(gate, 0)
    assert stop.sentence() == ""
    take(stop, NOW, True)
    take(stop, NOW + SECOND, True, "cmr-view", "the button on the page")
    assert stop.sentence().startswith("EMERGENCY STOP engaged by Ada: smoke, since 2023-11-1")
    assert "over restarts" not in stop.sentence(), "nothing keeps it"
    assert len(stop.news) == 1
    take(stop, NOW + 2 * SECOND, False, "Grace", "no smoke any more")
    assert stop.sentence() == ""
    assert stop.news[1:] == ["emergency stop released by Grace: no smoke any more"]
    assert not is_held(gate)


@pytest.mark.parametrize(
    ("source", "reason"),
    [("", ""), ("Ada", ""), ("", "clear"), (" ", "clear"), ("Ada", "\n"), ("??", "clear"), ("Ada", "...")],
)
def test_a_release_without_name_or_reason_releases_nothing_and_is_counted(
    gate: CommandGate, source: str, reason: str
) -> None:
    stop = BusStop(gate, 0)
    take(stop, NOW, True, "", "")
    take(stop, NOW + SECOND, False, source, reason)
    assert is_held(gate)
    assert stop.remarks()[1:] == ["Releases of ESTOP without name or reason: 1."]


def test_a_release_that_the_gate_does_not_take_releases_nothing(gate: CommandGate) -> None:
    stop = BusStop(gate, 0)
    take(stop, NOW, True)
    stop.handle(estop(NOW + SECOND, False), NOW + SECOND, utime=NOW + 2 * SECOND)
    assert is_held(gate)
    assert stop.sentence()


def test_words_of_a_stranger_are_cut_and_cannot_steer_a_terminal(gate: CommandGate) -> None:
    stop = BusStop(gate, 0)
    take(stop, NOW, True, "\x1b[2J", "x" * 100_000)
    assert stop.sentence().isprintable()
    assert len(stop.sentence()) < 600


def test_a_stop_holds_the_gate_of_the_next_driver_from_the_beginning(tmp_path: Path, gate: CommandGate) -> None:
    file = StopFile(tmp_path, 0, URL)
    with StopKeeper(file) as keeper:
        take(BusStop(gate, 0, keeper), NOW, True)
        wait_for(lambda: keeper.stored)
    restarted = CommandGate()
    with StopKeeper(file) as keeper:
        stop = BusStop(restarted, 0, keeper)
        assert is_held(restarted)
        assert stop.news == [stop.sentence()]
        assert "engaged by Ada: smoke" in stop.sentence()
        assert "also over restarts" in stop.sentence()
        take(stop, NOW + 3600 * SECOND, False)
        assert not is_held(restarted)
    assert file.load() is None


def test_after_a_restart_with_a_clock_that_is_behind_it_can_be_released(tmp_path: Path, gate: CommandGate) -> None:
    file = StopFile(tmp_path, 0, URL)
    file.store(EngagedStop(NOW, "Ada", "smoke"))
    stop = BusStop(gate, 0, StopKeeper(file))
    take(stop, 5 * SECOND, False)  # 1970: a small computer without a battery for its clock
    assert not is_held(gate)


def test_a_damaged_file_holds_the_robot_and_is_a_problem_until_the_release(tmp_path: Path, gate: CommandGate) -> None:
    file = StopFile(tmp_path, 0, URL)
    file.store(EngagedStop(NOW, "Ada", "smoke"))
    file.path.write_bytes(file.path.read_bytes()[:40])
    stop = BusStop(gate, 0, StopKeeper(file))
    assert is_held(gate)
    assert "is damaged. It is taken for an emergency stop that is engaged." in stop.problem
    take(stop, NOW, False)
    assert stop.problem == ""


def test_a_disk_that_refuses_does_not_keep_the_robot_from_stopping(tmp_path: Path, gate: CommandGate) -> None:
    file = StopFile(tmp_path, 0, URL)
    with StopKeeper(file) as keeper:
        stop = BusStop(gate, 0, keeper)
        file.path.mkdir()
        take(stop, NOW, True)
        assert is_held(gate)
        wait_for(lambda: "A restart forgets" in stop.problem)
        report = stop.reports(0.0, NOW)[0]
        assert (report.engaged, report.stored) == (True, False)


def test_it_is_reported_at_once_and_twice_a_second(gate: CommandGate) -> None:
    stop = BusStop(gate, 7)
    first = stop.reports(0.0, NOW)[0]
    assert (first.robot_id, first.engaged, first.since_utime, first.source) == (7, False, 0, "")
    assert stop.reports(0.1, NOW) == []
    take(stop, NOW + 5, True)
    engaged = stop.reports(0.2, NOW + 6)[0]
    assert (engaged.engaged, engaged.since_utime, engaged.source, engaged.reason) == (True, NOW + 5, "Ada", "smoke")
    assert stop.reports(0.2 + 0.9 * REPORT_PERIOD, NOW) == []
    assert stop.reports(0.2 + REPORT_PERIOD, NOW)[0].engaged
    take(stop, NOW + SECOND, False, "Grace", "clear")
    released = stop.reports(0.8, NOW)[0]
    assert (released.engaged, released.source, released.reason) == (False, "Grace", "clear")
