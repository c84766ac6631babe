"""cmr demo as a process of its own."""

import signal
import subprocess
import sys
from pathlib import Path


def demonstrated(out: Path, *options: str, patience: float) -> str:
    """Run cmr demo to its end, and return what it said; it is ended after `patience` [s], and must not fail."""
    command = [sys.executable, "-m", "cmr", "demo", *options, "--out", str(out)]
    demo = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        output, _ = demo.communicate(timeout=patience)
    finally:
        demo.send_signal(signal.SIGTERM)
    assert demo.returncode == 0, output
    return output
