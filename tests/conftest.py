"""What several test files share."""

import gc
import os
import sys
import tempfile
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from robot_driver.serial_port import SerialPort
from robot_driver.stream_port import StreamPort
from tests.support.exchanges import Exchanges
from tests.support.lanes import has_none_of
from tests.support.private_bus import private_url
from tests.support.stalls import Stalls

# As the commands have it, before NumPy is imported: threads of linear algebra cost small matrices three times the CPU.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# The first example may wait for a compiler, and any for a busy machine: no test of a promise fails for that.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")

os.environ["XDG_CONFIG_HOME"] = os.devnull  # a developer's own settings change no test
# An emergency stop that a test leaves engaged stops no robot of a later run, and a developer's own none of a test.
_STATE = tempfile.TemporaryDirectory(prefix="cmr-state-")
os.environ["XDG_STATE_HOME"] = _STATE.name
os.environ.pop("STATE_DIRECTORY", None)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files that have no test of the lane that is asked for: importing all of them takes seconds."""
    return True if has_none_of(config.option.markexpr, collection_path) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest first, so that nothing waits for them at the end."""
    items.sort(key=lambda item: item.get_closest_marker("longest") is None)


def pytest_collection_finish() -> None:
    """Have Python's garbage collector leave alone all that has been imported: looking through it takes 0.3 s.

    Drivers and emulated devices that run in the process of their tests would stand still for so long.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module", autouse=True)
def _laws_are_forgotten() -> Iterator[None]:
    """Take out of the catalogue what diagnoses learn in the tests of a file: other files do not know of it."""
    yield
    catalogue = sys.modules.get("cmr.model.catalogue")
    if catalogue is not None:
        for name in set(catalogue.LAWS):
            catalogue.unlearn(name)


@pytest.fixture
def url() -> str:
    """A bus that nobody else is on."""
    return private_url()


@pytest.fixture(scope="session")
def stalls() -> Iterator[Stalls]:
    """What stands still on this machine, whoever is to blame but the driver."""
    with Stalls() as watch:
        yield watch


@pytest.fixture
def exchanges(stalls: Stalls, monkeypatch: pytest.MonkeyPatch) -> Exchanges:
    """How all exchanges of this process with devices went."""
    result = Exchanges(stalls)
    for kind in (SerialPort, StreamPort):
        monkeypatch.setattr(kind, "exchange", result.noting(kind.exchange))
    return result


@pytest.fixture
def silent_port() -> Iterator[str]:
    """A port on which nothing ever answers."""
    master, slave = os.openpty()
    tty.setraw(slave)
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)
