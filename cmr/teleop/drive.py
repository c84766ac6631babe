"""A drive by hand: the gates of cmr-pilot, the claim of the robot, the emergency stop, and the resulting commands.

Independent of bus and clock: messages go in by `handle`, messages to send are returned by `turn`.
"""

from collections.abc import Callable
from dataclasses import dataclass

from cmr.bus.claiming import Claim
from cmr.bus.estop import HOW_TO_RELEASE, StopButton
from cmr.bus.message import Message
from cmr.bus.process import Outgoing
from cmr.bus.streams import COMMAND_CLAIM, ESTOP
from cmr.msg import command_owner_t, motor_feedback_t, parameters_t
from cmr.parameters.following import ParameterFollower
from cmr.recordings.arrivals import COMMANDS_OF
from cmr.teleop.by_hand import ByHand
from cmr.teleop.hands import FASTER, SLOWER, STILL, STOP, Hands
from cmr.teleop.recorder import Recorder
from cmr.world.pilot import Pilot
from cmr.world.view import VIRTUAL

OLD = 1_000_000  # us; older measurements are not shown
IGNORED = 1_500_000  # us of commands without motion after which a virtual robot is reported as ignoring them
LAST_ZEROS = 3
MOVING = 0.05  # rad/s of a wheel
TAKEN = "the end of {others}, which commands robot {robot}; --take-over does not wait"
NOT_COMMANDED = (
    "robot {robot} to move: it is virtual, and obeys commands only with the behaviour commanded "
    "(cmr-sim --virtual {robot}=commanded)"
)


@dataclass
class Measured:
    """Measurements reported by the robot: its last feedback, and its owner; None before the first."""

    feedback: motor_feedback_t | None = None
    owner: command_owner_t | None = None


class Drive:
    """A robot driven by hand. `waiting_for` says what prevents it from moving; empty if nothing does.

    A virtual robot without parameters of its own uses those made by `of_virtual`, as in cmr-sim.
    """

    def __init__(
        self,
        pilot: Pilot,
        hand: ByHand,
        claim: Claim,
        recorder: Recorder | None = None,
        of_virtual: Callable[[], ParameterFollower] | None = None,
    ) -> None:
        self.pilot, self.hand, self.claim, self.recorder = pilot, hand, claim, recorder
        self._of_virtual = of_virtual
        self.waiting_for = ""
        self.duties = (0.0, 0.0)
        self.measured = Measured()
        self.button = StopButton("cmr-teleop", "the person who drives")
        self._moved = 0  # when the robot last moved, or was last not commanded [us]

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Take a message from the bus."""
        if isinstance(message, parameters_t):
            self.pilot.parameters.handle(utime, channel, message)
            return
        self.pilot.handle(utime, channel, message)
        self.claim.handle(utime, channel, message)
        self.button.handle(utime, channel, message)
        if isinstance(message, motor_feedback_t) and message.robot_id == self.pilot.robot_id:
            self.measured.feedback = message
        elif isinstance(message, command_owner_t) and message.robot_id == self.pilot.robot_id:
            self.measured.owner = message

    def request(self, utime: int, what: str) -> None:
        """Handle a request other than driving, such as the emergency stop."""
        if what == STOP:
            self.button.stop(utime)
        elif what in (FASTER, SLOWER):
            self.hand.choose_speed(1 if what == FASTER else -1)

    def turn(self, utime: int, hands: Hands, unseen: str) -> list[Outgoing]:
        """Return the messages to send at `utime` [us]; `unseen` says why the input is not available, empty if it is."""
        outgoing: list[Outgoing] = []
        robot = self.pilot.robot_id
        self._look_for_parameters()
        if (stop := self.button.due(utime)) is not None:
            outgoing.append((ESTOP, None, stop))
        if (claimed := self.claim.message(utime)) is not None:
            outgoing.append((COMMAND_CLAIM, robot, claimed))
        self.hand.ask(STILL if self.button.stopped else hands)
        command = self.pilot.command(utime)
        self.duties = self.pilot.duties
        others = self.claim.others(utime)
        self.waiting_for = TAKEN.format(others=others, robot=robot) if others else self._what_is_missing(utime, unseen)
        if others:
            self.duties = (0.0, 0.0)
        else:
            outgoing.append((COMMANDS_OF[self.pilot.kind], robot, command))
        if self.recorder is not None:
            self.recorder.take(utime, self.duties, self.pilot.me)
        return outgoing

    def end(self, utime: int) -> list[Outgoing]:
        """Return the messages that end the drive: zero, and release of the robot; none if another process owns it."""
        if self.claim.others(utime):
            return []
        robot = self.pilot.robot_id
        return [  # a process that has ended cannot repeat its last messages, and any message may be lost
            *LAST_ZEROS * [(COMMANDS_OF[self.pilot.kind], robot, self.pilot.stop())],
            (COMMAND_CLAIM, robot, self.claim.end(utime)),
        ]

    def _look_for_parameters(self) -> None:
        me = self.pilot.me
        is_without = me is not None and me.origin == VIRTUAL and self.pilot.parameters.parameters is None
        if is_without and self._of_virtual is not None:
            self.pilot.parameters, self._of_virtual = self._of_virtual(), None

    def _what_is_missing(self, utime: int, unseen: str) -> str:
        if self.button.stopped:
            return f"release of the emergency stop ({self.button.text}): {HOW_TO_RELEASE}"
        if self.pilot.waiting_for:
            return self.pilot.waiting_for
        me = self.pilot.me
        turns = me is not None and max(abs(me.state.psi_left), abs(me.state.psi_right)) > MOVING
        if me is None or me.origin != VIRTUAL or turns or not any(self.duties):
            self._moved = utime
        ignored = utime - self._moved > IGNORED
        return NOT_COMMANDED.format(robot=self.pilot.robot_id) if ignored else unseen
