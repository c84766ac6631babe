"""What each parser of the driver, and each emulated controller, promises for any bytes, in pieces of any size.

    from tests.robot_driver.any_bytes import CHECKS

    CHECKS["roboclaw"](data)

A check takes any bytes as a script (script.py) of what a device sends: noise, whole answers, damaged ones. It raises
AssertionError when something is taken for a datum that is not, right to the checksum, among those bytes, when a whole
answer after them is not understood, or when bytes are waited for or kept without end. What else it raises came out of
the parser, which may raise nothing but BadReply. Checksums are computed by the emulator's code, not by the driver's.
The checks of emulated controllers play the client: nothing that is sent makes one die, or say what is no answer.
`tests/robot_driver/test_any_bytes.py` tries some hundred scripts, `scripts/fuzz` as many as one likes, guided by
coverage.
"""

from collections.abc import Callable

from tests.robot_driver.any_bytes import dsp3000, emulated, kvh_binary, mbot, roboclaw, roboteq

CHECKS: dict[str, Callable[[bytes], None]] = {
    "dsp3000": dsp3000.check,
    "emulated-mbot": emulated.check_mbot,
    "emulated-roboclaw": emulated.check_roboclaw,
    "emulated-roboteq": emulated.check_roboteq,
    "kvh-binary": kvh_binary.check,
    "mbot": mbot.check,
    "roboclaw": roboclaw.check,
    "roboteq": roboteq.check,
}
