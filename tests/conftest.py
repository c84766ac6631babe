"""What several test files share."""

import os

import pytest
from hypothesis import settings

from tests.private_bus import private_url

# As the commands have it, before NumPy is imported: threads of linear algebra cost small matrices three times the CPU.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# The first example may wait for a compiler, and any for a busy machine: no test of a promise fails for that.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")


@pytest.fixture
def url() -> str:
    """A bus that nobody else is on."""
    return private_url()
