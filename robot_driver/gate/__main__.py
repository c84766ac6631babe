"""Start the last gate by the path of this file, without any of the paths on which Python looks for other modules."""

import os
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))))  # noqa: PTH100, PTH120

from robot_driver.gate.process import main

if sys.argv[1:] == ["--modules"]:
    print("\n".join(f"{name} {getattr(module, '__file__', None)}" for name, module in sorted(sys.modules.items())))
else:
    main(sys.argv[1:])
