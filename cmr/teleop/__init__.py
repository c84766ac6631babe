"""Teleoperation: a keyboard, a gamepad or the joystick of a page drives a real or a virtual robot.

`hands` defines the interface of all input sources; `keyboard`, `gamepad`, `remote` and `scripted` are the sources;
`drive` computes the messages to send, without bus and clock; `seats` combine input and display. The process is in
`cmr.commands`.
"""

from cmr.teleop.by_hand import ByHand
from cmr.teleop.drive import Drive
from cmr.teleop.gamepad import Gamepad
from cmr.teleop.hands import Hands, Source
from cmr.teleop.keyboard import Keyboard
from cmr.teleop.recorder import Recorder
from cmr.teleop.remote import Remote
from cmr.teleop.scripted import Scripted

__all__ = ["ByHand", "Drive", "Gamepad", "Hands", "Keyboard", "Recorder", "Remote", "Scripted", "Source"]
