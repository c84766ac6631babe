"""What several test files share."""

import pytest
from hypothesis import settings

from tests.private_bus import private_url

# The first example may wait for a compiler, and any for a busy machine: no test of a promise fails for that.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")


@pytest.fixture
def url() -> str:
    """A bus that nobody else is on."""
    return private_url()
