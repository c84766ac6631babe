"""Guides a person through a procedure step by step: announcements, questions without a default, motions any key ends.

The procedure calls a `Guide`. A `Front` shows the steps and returns the answers: a terminal, a web page, or a script in
tests. Fronts are independent of the procedure, so the same steps can be answered anywhere.
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
