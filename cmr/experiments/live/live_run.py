"""One live run of a scenario: start the team, send waypoints, monitor, and detect the end."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cmr.bus.estop import EmergencyStop
from cmr.bus.message import Message
from cmr.bus.messages import now_utime
from cmr.bus.process import Process, Timer
from cmr.bus.streams import ESTOP, ESTOP_LATCH, PROCESS_REQUEST, PROCESS_STATUS, WAYPOINTS, WORLD_STATE
from cmr.cli.progress import Progress
from cmr.experiments.live.disk import Disk
from cmr.experiments.live.elsewhere import Elsewhere
from cmr.experiments.live.keeping_up import TOO_SLOW
from cmr.experiments.live.measuring import EndingMetric
from cmr.experiments.live.preparing import write_emulators, write_sim_scenario
from cmr.experiments.live.watch import TeamWatch
from cmr.experiments.team.plan import Scenario
from cmr.experiments.team.world import waypoints_message
from cmr.msg import process_status_t
from cmr.processes.children import Children
from cmr.processes.job import EMULATOR, PILOT, RECORDER, SIM, Job
from cmr.processes.requests import requests_of
from cmr.processes.supervisor import Supervisor
from cmr.world.remote_robots import named

RATE = 20.0  # Hz
START_UP = 240.0  # s for all robots and processes to be ready, on a slow computer that compiles the robot model
START_UP_BY_HAND = 1800.0  # s, if somebody has to start processes on other machines
GRACE = 30.0  # s for all processes to report no problem once all robots are present; then the run begins anyway
ANOTHER_WORD = 1.2  # s; within it each process has reported again: the first report comes before it knows its state
LISTENING = 0.4  # s in which a cmr-sim publishes its robots at least eight times
END_THE_OTHER = "end that cmr-run or cmr-sim, or use another --lcm-url"
SETTLING = 10.0  # s in which robots come to rest after the last waypoint
AT_REST = 1.0  # s without motion after which robots have come to rest
MOST_EVENTS = 2000  # kept for the report
REQUESTED_EVERY = 1.0  # s
STOPPED_TIMES = 5
WAYPOINTS_A_TURN = 20  # messages; a thousand at once would overrun a socket's buffer


@dataclass(frozen=True)
class Outcome:
    """The end of a run: its reason, and the time [s] since all were ready.

    `failed` means that it never began, or could not be recorded to its end.
    """

    ended_by: str
    seconds: float
    failed: bool = False
    interrupted: bool = False


class LiveRun:
    """A run of a scenario, whose files lie in `folder`, by the processes `jobs` here and `others` on other machines.

    Agents there are asked to run them as soon as they are detected. Events are reported on the terminal and on
    PROCESS_STATUS, and kept in `events` as (seconds since the start, text).
    """

    def __init__(
        self,
        scenario: Scenario,
        folder: Path,
        process: Process,
        jobs: Sequence[Job],
        children: Children,
        progress: Progress,
        others: Sequence[Job] = (),
    ) -> None:
        self.scenario = scenario
        self.watch = TeamWatch(scenario)
        self._ending_metric = EndingMetric(scenario, self.watch)
        self.elsewhere = Elsewhere(others, self.watch.statuses_elsewhere)
        self.supervisor = Supervisor(jobs, children, self.watch.is_degraded, self._prepare, self._may_start)
        self.events: list[tuple[float, str]] = []
        self._left_out = 0
        self._folder = folder
        self._disk = Disk(folder)
        self._process = process
        self._request = Timer(REQUESTED_EVERY)
        self._emergency_stop = EmergencyStop()
        self._bar = progress
        self._created = time.monotonic()
        self._is_ready = False
        self._seconds = 0.0  # since all were ready
        self._there_since: float | None = None  # when all robots were in the world
        self._over_since: float | None = None
        self._moved = 0.0  # when a robot last moved, in seconds since all were ready
        self._to_send: set[int] = set()  # robots whose waypoints are still to be sent
        process.subscribe(WORLD_STATE, every=True)
        process.subscribe(PROCESS_STATUS, every=True)
        process.subscribe(ESTOP, every=True)
        process.subscribe(ESTOP_LATCH, every=True)

    def run(self) -> Outcome:
        """Start everything, and return when the run is over; nothing is stopped yet."""
        self._disk.hold_room()
        if taken := self._taken():
            return Outcome(taken, 0.0, failed=True)
        for _utime in self._process.loop(RATE):
            self._turn()
            missing = self._missing()
            doubt = "" if missing else self._doubt()
            lacking = missing or doubt
            if lacking:
                self._bar.show(f"Waiting for {lacking}")
            self._there_since = None if missing else (self._there_since or time.monotonic())
            if self._there_since is not None and time.monotonic() - self._there_since > (
                GRACE if doubt else ANOTHER_WORD
            ):
                return self._drive(doubt)
            if unrecorded := self._why_unrecorded():
                return Outcome(unrecorded, 0.0, failed=True)
            given_up = self.supervisor.given_up()
            if given_up:
                return Outcome(f"{given_up[0]} is not restarted", 0.0, failed=True)
            patience = START_UP_BY_HAND if self.elsewhere.is_needed else START_UP
            if time.monotonic() - self._created > patience:
                return Outcome(f"waited {patience:.0f} s in vain for {lacking.rstrip('.')}", 0.0, failed=True)
        return Outcome("somebody ended it before all were ready", 0.0, interrupted=True)

    def stop(self) -> None:
        """Stop all processes of the run, here and by agents on other machines; then release the space for a report."""
        for _ in range(STOPPED_TIMES if self.elsewhere.asked_of_agents() else 0):  # any message may be lost
            self._ask_agents(wanted=False)
            time.sleep(REQUESTED_EVERY / STOPPED_TIMES)
        self.supervisor.stop()
        self._disk.give_room()

    def say(self, words: str) -> None:
        """Report and keep an event; of very many, the first and last."""
        self.events.append((time.monotonic() - self._created, words))
        if len(self.events) > MOST_EVENTS:
            self._left_out += 1
            self.events[MOST_EVENTS // 2 - 1 : MOST_EVENTS // 2 + 1] = [
                (self.events[MOST_EVENTS // 2][0], f"... {self._left_out} more events, which are not kept")
            ]
        self._bar.say(words)

    def _taken(self) -> str:
        """Listen for a moment; return a sentence if another process already simulates our robots, otherwise empty."""
        if SIM not in {state.job.role for state in self.supervisor.states.values()}:
            return ""
        until = time.monotonic() + LISTENING
        for _utime in self._process.loop(RATE):
            self._process.state = process_status_t.STARTING
            self._process.dispatch(self.watch.handle)
            if time.monotonic() > until:
                break
        seen = sorted(self.watch.poses())
        return f"on this bus somebody moves {named(seen)} already: {END_THE_OTHER}" if seen else ""

    def _drive(self, doubt: str) -> Outcome:
        """Let the team drive until the run is over; `doubt` is a problem reported by a process."""
        count = len(self.scenario.robots)
        if doubt:
            self.say(f"Starting after {GRACE:.0f} s, although one process has a problem: {doubt}")
        else:
            self.say(f"{f'All {count} robots are' if count > 1 else 'The robot is'} ready.")
        self._is_ready = True
        began = time.monotonic()
        self.watch.begin()
        self._report_state()
        self._process.publish_status()  # all robots begin on this report
        for _utime in self._process.loop(RATE):
            self._seconds = time.monotonic() - began
            self._turn()
            self._send_waypoints()
            self._bar.show(self._progress())
            if unrecorded := self._why_unrecorded():
                return Outcome(unrecorded, self._seconds, failed=True)
            reason = self._why_over()
            if reason:
                return Outcome(reason, self._seconds)
        return Outcome("somebody ended it", self._seconds, interrupted=True)

    def _turn(self) -> None:
        """Receive messages, restart dead processes, and report the state on PROCESS_STATUS."""
        self._process.dispatch(self._hear)
        if self.elsewhere.newcomers():
            waypoints = self.watch.remaining_waypoints()
            self._to_send.update(
                robot_id for robot_id, way in waypoints.items() if way and self._is_moved_elsewhere(robot_id)
            )
        self._supervise()
        if self._request.due():
            self._ask_agents(wanted=True)
        self._report_state()

    def _report_state(self) -> None:
        """Report STARTING until all are ready, whatever happens; then report missing processes."""
        down = self.supervisor.down()
        begun = process_status_t.DEGRADED if down else process_status_t.RUNNING
        self._process.state = begun if self._is_ready else process_status_t.STARTING
        self._process.message = f"Not running: {', '.join(down)}." if down else self._disk.shortage

    def _supervise(self) -> None:
        """Restart dead processes, and check the free disk space."""
        try:
            sentences = [self._disk.look(), *self.supervisor.poll(time.monotonic())]
        except OSError as error:  # files of a process that was to be restarted
            self._disk.note(error)
            return
        for sentence in filter(None, sentences):
            self.say(sentence)

    def _why_unrecorded(self) -> str:
        """Return why the run can no longer be recorded; empty while it can."""
        if self.supervisor.is_unrecorded and not self._disk.full:
            said = self.supervisor.last_words(RECORDER)
            return said.rstrip(".") or f"nothing more can be recorded in {self._folder}"
        return self._disk.full

    def _ask_agents(self, wanted: bool) -> None:
        for request in requests_of(self.elsewhere.asked_of_agents(), self._folder, now_utime(), wanted):
            self._process.publish(PROCESS_REQUEST, request)

    def _hear(self, utime: int, channel: str, message: Message) -> None:
        self.watch.handle(utime, channel, message)
        stop, was_engaged = self._emergency_stop, self._emergency_stop.engaged
        stop.handle(utime, channel, message)
        if stop.engaged != was_engaged:
            self.say(f"ESTOP is engaged by {stop.reason}." if stop.engaged else "ESTOP is released.")

    def _missing(self) -> str:
        """Return the missing robots or processes; empty if there are none."""
        if elsewhere := self.elsewhere.silent():
            return elsewhere
        missing = self.watch.missing()
        if missing:
            return f"{named(missing)} in WORLD_STATE"
        names = self.supervisor.states
        silent = [name for name in names if not self._is_heard(name) and not self.supervisor.is_done(name)]
        return self._words_of(silent[0]) if silent else ""

    def _doubt(self) -> str:
        """Return the first process that reports a problem, with its message; empty if none does."""
        states = self.supervisor.states
        ill = [name for name in states if self._is_heard(name) and self.watch.is_degraded(states[name].pid)]
        return self._words_of(ill[0]) if ill else self.elsewhere.doubt()

    def _words_of(self, name: str) -> str:
        status = self.watch.statuses.get(self.supervisor.states[name].pid)
        said = status.message if status is not None else self.supervisor.last_words(name)
        return f"{name}{': ' + said if said else ''}"

    def _is_heard(self, name: str) -> bool:
        """Return whether the latest instance of a process has been received on the bus."""
        status = self.watch.statuses.get(self.supervisor.states[name].pid)
        return status is not None and status.state != process_status_t.STARTING

    def _prepare(self, job: Job) -> None:
        """Before a process (re)starts: write its files so that robots continue from where they are, with the remaining
        waypoints.
        """
        waypoints = self.watch.remaining_waypoints()
        if job.role == EMULATOR:
            write_emulators(self.scenario, self._folder, self.watch.poses())
        elif job.role == SIM:
            write_sim_scenario(self.scenario, self._folder, self.watch.poses())
            self._to_send.update(robot.robot_id for robot in self.scenario.virtual if waypoints.get(robot.robot_id))
        elif job.role == PILOT and job.robot_id is not None and waypoints.get(job.robot_id):
            self._to_send.add(job.robot_id)

    def _may_start(self, job: Job) -> bool:
        """Return whether a process may start: a pilot once the robot's driver is there.

        A robot is in the world as soon as it is received. If a pilot commands it before its driver listens, only the
        twin drives off.
        """
        driver = f"driver {job.robot_id}"
        return job.role != PILOT or driver not in self.supervisor.states or self._is_heard(driver)

    def _is_moved_elsewhere(self, robot_id: int) -> bool:
        robot = self.scenario.robot(robot_id)
        is_virtual = robot is not None and robot.kind == "virtual"
        return self.elsewhere.has_sim if is_virtual else robot_id in self.elsewhere.with_pilot

    def _send_waypoints(self) -> None:
        """Send robots their waypoints once the process that moves them is ready."""
        waypoints = self.watch.remaining_waypoints()
        for robot_id in sorted(self._to_send)[:WAYPOINTS_A_TURN]:
            pilot, states = f"pilot {robot_id}", self.supervisor.states
            name = pilot if pilot in states else "sim"
            if name not in states or self._is_heard(name):
                here = self.watch.pose(robot_id)
                points = ((here.x, here.y), *waypoints[robot_id])  # the path to the first waypoint counts as well
                self._process.publish(WAYPOINTS, waypoints_message(now_utime(), robot_id, points), robot_id)
                self._to_send.discard(robot_id)

    def _progress(self) -> str:
        """Return the progress in one line that fits a terminal of 80 columns."""
        watch, count = self.watch, len(self.scenario.robots)
        there = count - len(watch.missing())
        restarts = self.supervisor.restarts
        parts = [
            "ESTOP" if self._emergency_stop.engaged else "",
            f"{max(self.scenario.duration - self._seconds, 0.0):.0f} s left",
            f"{there if there == count else f'{there}/{count}'} robot{'s' if count > 1 else ''}",
            self._pace(),
            f"{watch.overruns} late cycles",
            f"{restarts} restart{'s' if restarts > 1 else ''}" if restarts else "",
            f"{watch.measure('distance_driven'):.1f} m {'each' if count > 1 else 'driven'}",
            f"nearest {watch.nearest.distance:.2f} m" if watch.nearest.utime else "",
        ]
        return ", ".join(part for part in parts if part)

    def _pace(self) -> str:
        """Return the publishing rate of the world, and whether it is too low."""
        rate, wanted = self.watch.rate(), self.scenario.rate
        return f"{rate:.0f} of {wanted:.0f} Hz{' (computer too busy)' if rate < TOO_SLOW * wanted else ''}"

    def _why_over(self) -> str:
        """Return why the run is over; empty while it is not."""
        ending, watch = self.scenario.ends_when, self.watch
        if self._seconds >= self.scenario.duration:
            return "its time is over"
        if reason := self._ending_metric.reason(self._seconds):
            return reason
        if not (ending.waypoints_reached and watch.waypoints_reached):
            return ""
        if self._over_since is None:
            self._over_since = self._seconds
        if watch.moving.any():
            self._moved = self._seconds
        settled = self._seconds - self._moved > AT_REST or self._seconds - self._over_since > SETTLING
        return "all waypoints are reached" if settled else ""
