"""Guides a person through a procedure step by step: announcements, questions without a default, motions any key ends.

The procedure speaks to a `Guide`. What shows the steps and brings the answers is a `Front`: a terminal, a web page, or
a script in tests. None of them knows the procedure, so the same steps can be answered anywhere.
"""

from robot_driver.guided.guide import Front, Guide, Left, Motion
from robot_driver.guided.remote import Remote
from robot_driver.guided.scripted import NotInTheScript, Scripted
from robot_driver.guided.steps import Choice, Kind, Step, no_or_yes
from robot_driver.guided.terminal import Terminal

__all__ = [
    "Choice",
    "Front",
    "Guide",
    "Kind",
    "Left",
    "Motion",
    "NotInTheScript",
    "Remote",
    "Scripted",
    "Step",
    "Terminal",
    "no_or_yes",
]
