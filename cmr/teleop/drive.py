"""A drive by hand: the gates of cmr-pilot, the claim of the robot, the emergency stop, and what becomes of it.

It knows neither bus nor clock: messages go in by `handle`, what is to be sent comes out of `turn`.
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

OLD = 1_000_000  # us; what was measured longer ago is shown no more
IGNORED = 1_500_000  # us of commands, for which a virtual robot does not move, until that is said
LAST_ZEROS = 3
MOVING = 0.05  # rad/s of a wheel
TAKEN = "the end of {others}, which commands robot {robot}; --take-over does not wait"
NOT_COMMANDED = (
    "robot {robot} to move: it is virtual, and obeys commands only with the behaviour commanded "
    "(cmr-sim --virtual {robot}=commanded)"
)


@dataclass
class Measured:
    """What the robot reports: its last feedback, and who owns it; None before the first."""

    feedback: motor_feedback_t | None = None
    owner: command_owner_t | None = None


class Drive:
    """One robot that is led by hand. `waiting_for` says what keeps it from moving; empty when nothing does.

    A virtual robot without parameters of its own goes by those that `of_virtual` makes, as in cmr-sim.
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
        self._moved = 0  # when a robot that is commanded last moved, or was not commanded [us]

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

    def wish(self, utime: int, what: str) -> None:
        """Do what was wished besides driving."""
        if what == STOP:
            self.button.stop(utime)
        elif what in (FASTER, SLOWER):
            self.hand.choose_speed(1 if what == FASTER else -1)

    def turn(self, utime: int, hands: Hands, unseen: str) -> list[Outgoing]:
        """Return what is to be sent at `utime` [us]; `unseen` is why the hands are not seen, empty if they are."""
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
        """Return what ends the drive: zero, and the robot is left to others; nothing where somebody else has it."""
        if self.claim.others(utime):
            return []
        robot = self.pilot.robot_id
        return [  # the last words of a process are not repeated later, and any message may be lost
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
