"""What several test files share."""

import pytest

from tests.private_bus import private_url


@pytest.fixture
def url() -> str:
    """A bus that nobody else is on."""
    return private_url()
