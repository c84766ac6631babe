"""Run a soak test: start cmr-driver and an emulated robot in processes of their own, cause faults, and check."""

import multiprocessing
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from contextlib import ExitStack
from pathlib import Path
from random import Random
from typing import Any

from cmr.bus.bus import Bus
from cmr.bus.messages import now_utime
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, PROCESS_STATUS
from cmr.files import gone_before_and_after
from soaking import plan, robot
from soaking.checks import (
    CYCLE,
    RECOVERY,
    US_PER_S,
    DriveChecks,
    Findings,
    Gaps,
    GroundTruth,
    GyroChecks,
    MotorChecks,
    WaitHistory,
    Window,
)
from soaking.pilot import LARGEST_DUTY, Pilot
from soaking.waiting import SchedulerWaits
from tests.support.gates import gates_of
from tests.support.private_bus import private_url
from tests.support.stalls import Stalls

DRIVER = [sys.executable, "-c", "import sys; from cmr.commands import driver; sys.exit(driver())"]
LOOP_PERIOD = 0.02  # s
CALM = 10.0  # s without invalid commands at the beginning and the end, so that the last status has the final counts
SAMPLE = 0.05  # s between samples of the time spent waiting for a processor
MEMORY_SAMPLE = 5.0  # s
MEMORY_FROM = 60.0  # s after which growth is measured
LARGEST_GROWTH = 5e6  # bytes
LARGEST_GROWTH_OF_GATE = 0.3e6  # bytes; Python allocates a quarter of this or more at a time
LONGEST_STATUS_GAP = 2 * US_PER_S  # us
WAITS_FOR_ZERO = "Waiting for zero to be commanded"
SETTLED = US_PER_S // 2  # us by which the ground truth must be ahead of a message that is checked
PAGE = os.sysconf("SC_PAGE_SIZE")
INTERRUPTED = 130


class Soak:
    """One soak test; after `run`, `findings` holds the results."""

    def __init__(self, folder: Path, gyro: str, seed: int) -> None:
        self.findings = Findings()
        self.faults: Counter[str] = Counter()
        self.memory: list[tuple[float, int]] = []  # time since the start [s], bytes
        self.memory_of_gate: list[tuple[float, int]] = []
        self.statuses: deque[Any] = deque(maxlen=1000)
        self.damages = 0
        self._folder = folder
        self._gyro = gyro
        self._rng = Random(seed)
        self._seed = seed
        self._ground_truth = GroundTruth()
        self._waits = WaitHistory()
        self._gaps = {
            stream: Gaps(stream, line, period, self._ground_truth, self._waits, self.findings)
            for stream, line, period in (("MOTOR_FEEDBACK", "motor", CYCLE), ("GYRO", "gyro", robot.GYRO_PERIOD))
        }
        self._motor = MotorChecks(self._ground_truth, self._gaps["MOTOR_FEEDBACK"], self._waits, self.findings)
        self._gyro_checks = GyroChecks(self._ground_truth, self._gaps["GYRO"], self._waits, self.findings)
        self.drive = DriveChecks(
            self._ground_truth, self._gaps["MOTOR_FEEDBACK"], self._waits, self.findings, LARGEST_DUTY
        )
        self._to_check: deque[Any] = deque()
        self._plan = plan.faults(Random(seed))
        self._fault: plan.Fault | None = None
        self._windows: list[Window] = []
        self._fault_due = 5.0
        self._last_status = 0

    def run(self, seconds: float) -> None:
        """Run the soak test for `seconds`."""
        bus = Bus(private_url())
        for stream in (MOTOR_FEEDBACK, GYRO, PROCESS_STATUS):
            bus.subscribe(stream, every=True)
        with ExitStack() as stack:
            connection = stack.enter_context(self._emulated_robot(stack))
            self._stalls = stack.enter_context(Stalls())
            driver = self._driver(bus.url, stack)
            self.pilot = Pilot(bus, self.drive, self._rng)
            self._loop(bus, connection, driver, seconds)
            self._end(connection, driver)

    def _emulated_robot(self, stack: ExitStack) -> Any:
        context = multiprocessing.get_context("spawn")
        connection, other_end = context.Pipe()
        process = context.Process(target=robot.run, args=(other_end, self._folder, self._gyro, self._seed), daemon=True)
        process.start()
        other_end.close()
        stack.callback(process.join)
        assert process.pid is not None
        self._emulator = process.pid
        assert connection.recv() == []
        for order in plan.always():
            connection.send(order)
        return connection

    def _driver(self, url: str, stack: ExitStack) -> subprocess.Popen[bytes]:
        arguments = ["--port", str(self._folder / "motor"), "--gyro-port", str(self._folder / "gyro")]
        arguments += ["--gyro", self._gyro, "--rate", "50", "--battery-warn", "11", "--battery-stop", "10"]
        state = self._folder / "state"  # an emergency stop of one run must not affect the next
        stack.enter_context(gone_before_and_after(state))
        arguments += ["--state", str(state)]
        log = stack.enter_context((self._folder / "driver.log").open("wb"))
        process = subprocess.Popen([*DRIVER, *arguments, "--lcm-url", url], stderr=log)
        stack.callback(process.kill)
        return process

    def _loop(self, bus: Bus, connection: Any, driver: subprocess.Popen[bytes], seconds: float) -> None:
        began = due = time.monotonic()
        sample = memory = 0.0
        gate = _gate_of(driver)
        waiting = SchedulerWaits((driver.pid, gate, self._emulator))
        while (passed := time.monotonic() - began) < seconds:
            if driver.poll() is not None:
                self.findings.report_failure(now_utime(), f"cmr-driver ended with {driver.returncode}")
                return
            self._update_fault(connection, passed, seconds)
            self.pilot.step(with_invalid=CALM < passed < seconds - CALM)
            if passed >= sample:
                sample += SAMPLE
                self._waits.add(now_utime(), waiting.sample())
                self._note_stalls()
            if passed >= memory:
                memory += MEMORY_SAMPLE
                if gates_of(driver.pid) != [gate]:
                    self.findings.report_failure(now_utime(), "the last gate has ended")
                    return
                self.memory.append((passed, _resident(driver.pid)))
                self.memory_of_gate.append((passed, _resident(gate)))
            self._receive_records(connection)
            self._check()
            due = max(due + LOOP_PERIOD, time.monotonic())
            while (remaining := due - time.monotonic()) > 0.0:
                self._receive_messages(bus, remaining)

    def _note_stalls(self) -> None:
        self._stalls.look()
        epoch = now_utime() - round(time.monotonic() * US_PER_S)
        for begin, end in self._stalls.seen:
            self.findings.note_stall(epoch + round(begin * US_PER_S), epoch + round(end * US_PER_S))
        self._stalls.seen.clear()

    def _update_fault(self, connection: Any, passed: float, seconds: float) -> None:
        """Begin or end a fault when it is due; none begins near the end."""
        if passed < self._fault_due:
            return
        if self._fault is None:
            if passed > seconds - CALM:
                return
            fault = self._fault = next(self._plan)
            self.faults[fault.name] += 1
            self._windows = [Window(stream, fault.name, now_utime(), 2**62) for stream in self._gaps]
            for window in self._windows:
                self._list_of(window).append(window)
            for order in fault.begin:
                connection.send(order)
            self._fault_due = passed + fault.seconds
            return
        for order in self._fault.end:
            connection.send(order)
        for window in self._windows:
            windows = self._list_of(window)
            windows[windows.index(window)] = window._replace(end=now_utime() + RECOVERY)
        self._fault = None
        self._fault_due = passed + self._rng.uniform(*plan.REST)

    def _list_of(self, window: Window) -> list[Window]:
        """Return the list for a window of the current fault: faults that interrupt its stream, or others."""
        assert self._fault is not None
        gaps = self._gaps[window.stream]
        return gaps.windows if window.stream in self._fault.streams else gaps.others

    def _receive_records(self, connection: Any) -> None:
        while connection.poll():
            for record in connection.recv():
                self._ground_truth.add(record)
                if record.kind == "duty":
                    self.drive.check(record)
                elif record.kind == "damage":
                    self.damages += record.value[1]
                elif record.kind == "late":
                    key = "the emulator ran late"
                    self.findings.largest[key] = max(self.findings.largest[key], record.value[1] / US_PER_S)

    def _receive_messages(self, bus: Bus, seconds: float) -> None:
        for received in bus.receive(seconds):
            if received.stream is PROCESS_STATUS:
                self._take_status(received.message)
            else:
                self._to_check.append((received.stream, received.message))

    def _take_status(self, status: Any) -> None:
        if self._last_status and status.utime - self._last_status > LONGEST_STATUS_GAP:
            self.findings.report_failure(
                status.utime, f"no PROCESS_STATUS for {(status.utime - self._last_status) / 1e6:.1f} s"
            )
        self._last_status = status.utime
        if WAITS_FOR_ZERO in status.message:
            self.pilot.asked_for_zero(status.utime)
        self.statuses.append(status)

    def _check(self) -> None:
        """Check everything for which the ground truth is complete."""
        while self._to_check and self._to_check[0][1].received_utime + SETTLED < self._ground_truth.upto:
            stream, message = self._to_check.popleft()
            (self._motor if stream is MOTOR_FEEDBACK else self._gyro_checks).check(message)
        self.drive.judge()

    def _end(self, connection: Any, driver: subprocess.Popen[bytes]) -> None:
        """End the driver as a user does, and check that the motors are at zero afterwards."""
        asked = time.monotonic()
        driver.send_signal(signal.SIGTERM)
        code = driver.wait(10.0)
        self.findings.largest["from SIGTERM to the end"] = time.monotonic() - asked
        if code != INTERRUPTED:
            self.findings.report_failure(now_utime(), f"cmr-driver ended with {code} instead of {INTERRUPTED}")
        ended = now_utime()
        while self._ground_truth.upto < ended:
            self._receive_records(connection)
            time.sleep(LOOP_PERIOD)
        if any(self._ground_truth.last_before("duty", ended) or ()):
            self.findings.report_failure(ended, "cmr-driver left the motors driven")


def soak(minutes: float, gyro: str, seed: int) -> Soak:
    """Run a soak test and return it."""
    with tempfile.TemporaryDirectory(prefix="cmr-soak-") as folder:
        result = Soak(Path(folder), gyro, seed)
        result.run(60.0 * minutes)
        return result


def growth(memory: list[tuple[float, int]]) -> int:
    """Return by how many bytes the memory of a process exceeded that of the first minute."""
    first = [used for passed, used in memory if passed <= MEMORY_FROM]
    return max(used for _, used in memory) - max(first)


def rejected(message: str) -> dict[str, int]:
    """Return the numbers of rejected commands in the driver's status, by reason."""
    return {reason: int(count) for reason, count in re.findall(r"\b([a-z_]+) (\d+)", message)}


def _gate_of(driver: subprocess.Popen[bytes]) -> int:
    """Wait for the driver's last gate; return its process id."""
    while not (found := gates_of(driver.pid)):
        time.sleep(LOOP_PERIOD)
    return found[0]


def _resident(pid: int | None) -> int:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE
