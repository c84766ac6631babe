"""On a full disk a command says so in a sentence, and leaves no half-written file."""

import errno
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cmr.cli.command_line import guarded
from cmr.cli.errors import CommandError
from cmr.files import write_atomically
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.events import event_bytes
from cmr_tools.importing.import_log import main as import_command
from tests.support.full_disk import no_file_larger_than
from tests.support.small_log import small_log
from tests.tools.importing.import_bench import CSV_HEAD, POSE, write_csv, write_mapping

LOG = str(Path(sys.executable).parent / "cmr-log")


def failing(error: OSError) -> Callable[[list[str]], int]:
    def main(_arguments: list[str]) -> int:
        raise error

    return main


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_full_disk_is_one_sentence(number: int, capfd: pytest.CaptureFixture[str]) -> None:
    assert guarded(failing(OSError(number, "No space left on device", "/data/run.lcm")), []) == 1
    said = capfd.readouterr().err
    assert said.count("\n") == 1
    assert "/data/run.lcm: No space left on device. Free some space" in said
    with pytest.raises(OSError, match="broken"):
        guarded(failing(OSError(errno.EIO, "broken")), [])


def test_what_is_printed_into_a_full_disk_ends_with_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "run.lcm").write_bytes(b"".join(map(event_bytes, small_log())))
    with Path("/dev/full").open("w") as full:
        command = [LOG, "info", str(tmp_path / "run.lcm")]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "cmr-log: No space left on device. Free some space on that disk, then try again.\n"


def test_a_parameter_file_stays_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "robot_0.yaml"
    ParameterFile(0, {"wheel_radius": Value(0.04)}).save(path)
    before = path.read_bytes()
    with no_file_larger_than(50), pytest.raises(OSError, match="File too large"):
        ParameterFile(0, {"wheel_radius": Value(0.05), "base_width": Value(0.2)}).save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with no_file_larger_than(0), pytest.raises(OSError, match="File too large"):
        write_atomically("text", tmp_path / "new.txt")
    assert list(tmp_path.iterdir()) == [path]


def test_an_import_that_does_not_fit_leaves_the_log_that_was_there(tmp_path: Path) -> None:
    rows = "".join(f"{0.01 * k:.2f},100,0,0\n" for k in range(2000))
    mapping = write_mapping(tmp_path, CSV_HEAD | {"pose": POSE})
    recording, out = write_csv(tmp_path, "t,x,y,theta\n" + rows), tmp_path / "run.lcm"
    out.write_bytes(b"the log of before")
    before = sorted(tmp_path.iterdir())
    with no_file_larger_than(10_000), pytest.raises(CommandError, match=r"run.lcm: File too large"):
        import_command([mapping, str(recording), "--out", str(out)])
    assert sorted(tmp_path.iterdir()) == before
    assert out.read_bytes() == b"the log of before"
