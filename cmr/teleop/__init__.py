"""Driving by hand: a keyboard, a gamepad or the joystick of a page leads a real or a virtual robot.

`hands` says what all of them promise; `keyboard`, `gamepad`, `remote` and `scripted` are what hands hold; `drive` is
what becomes of it, without bus and clock; `seats` are where a person drives from. The process is in `cmr.commands`.
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
