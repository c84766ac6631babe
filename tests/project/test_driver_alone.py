"""What is installed on a robot's own computer is complete, and needs three libraries alone."""

import sys

import pytest

from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from documentation.imports import GENERATED, TYPING, imported_by, modules, parsed
from shipping.contents import LIBRARIES, OPTIONAL_IMPORTS, driver_files, driver_modules

pytestmark = pytest.mark.slow

OURS = {"cmr", "cmr_tools", "robot_driver"}

# Not on a robot: what stands in for one, the bridge to those that speak ROS 2, and the page of a report, for which
# it has no modules.
ELSEWHERE = "robot_driver/emulator", "robot_driver/simulated", "robot_driver/ros2", "robot_driver/acceptance/page.py"


def test_it_imports_nothing_but_its_three_libraries_and_python_s_own() -> None:
    sources = modules(PROJECT)
    needed = {
        (module, name.partition(".")[0])
        for module in driver_modules()
        if module != GENERATED
        for name, kind in imported_by(parsed(sources[module]))
        if kind != TYPING and name.partition(".")[0] not in {*sys.stdlib_module_names, *OURS}
    }
    assert needed - OPTIONAL_IMPORTS.keys() <= {
        (module, library) for module in driver_modules() for library in LIBRARIES
    }
    assert needed >= OPTIONAL_IMPORTS.keys()


def test_it_has_the_driver_and_what_that_starts_and_no_robot_that_is_emulated() -> None:
    there = set(driver_files())
    assert {"robot_driver/main.py", "cmr/bus/bus.py", "cmr/commands/estop.py", "cmr/msg/estop_t.py"} <= there
    assert "robot_driver/__init__.py" in there
    devices = {path.relative_to(PROJECT).as_posix() for path in (PROJECT / "robot_driver").rglob("*.py")}
    assert {name for name in devices - there if not name.startswith(ELSEWHERE)} == set()
    assert not any(name.startswith(("robot_driver/emulator", "robot_driver/simulated", "cmr/world")) for name in there)
