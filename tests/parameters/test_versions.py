"""A version from the future does not shut out what follows it: live, on the page and in a log."""

from typing import Any

from cmr.parameters.file import announcement
from cmr.parameters.versions import MOST_EARLY, Versions
from cmr.recordings.arrivals import Announcements
from cmr.view.data.state import ViewState
from tests.parameters.test_parameter_file import with_radius

EPOCH = 1_800_000_000_000_000  # us
LAST = 2**63 - 1


def announced(radius: float, sequence: int, utime: int) -> Any:
    message = announcement(0, with_radius(radius).to_yaml(), sequence)
    message.utime = utime
    return message


def test_a_version_from_the_future_counts_as_of_when_it_was_first_heard() -> None:
    versions = Versions()
    early = announced(0.05, LAST, EPOCH)
    assert versions.of(announced(0.04, EPOCH - 5, EPOCH), EPOCH) == EPOCH - 5
    assert [versions.of(early, EPOCH + k) for k in range(3)] == [EPOCH] * 3
    for k in range(MOST_EARLY * 3):  # of many such only some are remembered, and those that are repeated
        versions.of(announced(0.05, LAST - 1 - k, EPOCH), EPOCH)
        assert versions.of(early, EPOCH + k) == EPOCH


def test_the_page_shows_what_follows_a_version_from_the_future() -> None:
    state = ViewState()
    state.handle(EPOCH, "PARAMETERS_0", announced(0.05, LAST, EPOCH))
    assert state.latest["PARAMETERS"][0].message.utime == EPOCH
    state.handle(EPOCH + 9, "PARAMETERS_0", announced(0.1, EPOCH + 8, EPOCH + 9))
    state.handle(EPOCH + 10, "PARAMETERS_0", announced(0.05, LAST, EPOCH + 10))
    assert state.latest["PARAMETERS"][0].message.utime == EPOCH + 9


def test_a_recording_takes_what_follows_a_version_from_the_future() -> None:
    for stamp in (EPOCH, LAST):
        announcements = Announcements()
        for k, message in enumerate((announced(0.05, LAST, stamp), announced(0.06, EPOCH + 1, EPOCH + 1))):
            announcements.take(k, "PARAMETERS_0", message)
        newest = announcements.newest(9)
        assert newest is not None
        assert newest.value("wheel_radius") == 0.06
