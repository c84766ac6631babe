"""Another clock is followed by the messages that arrived soonest."""

import numpy as np
import pytest

from cmr.bus.clock_map import ClockMap


def fed(seconds: float, *, drift: float, rate: float = 200.0, late: float = 0.003, seed: int = 0) -> ClockMap:
    """Return a map after messages of a clock that is 50 s ahead and gains, held up by `late` on average."""
    random = np.random.default_rng(seed)
    clock = ClockMap()
    for sent in np.arange(0.0, seconds, 1.0 / rate):
        here = 50.0 + (1.0 + drift) * sent
        clock.add(float(sent), float(here + random.exponential(late)))
    return clock


@pytest.mark.parametrize("drift", [-5e-5, 0.0, 5e-5])
@pytest.mark.parametrize("seconds", [2.0, 30.0, 120.0])
def test_a_drifting_clock_is_followed_within_a_tenth_of_a_millisecond(drift: float, seconds: float) -> None:
    clock = fed(seconds, drift=drift)
    assert clock.is_known
    assert clock.here(seconds) == pytest.approx(50.0 + (1.0 + drift) * seconds, abs=1.5e-4)


def test_a_clock_is_not_known_at_first() -> None:
    assert not fed(0.3, drift=0.0).is_known


def test_messages_that_are_held_up_for_long_change_nothing() -> None:
    clock = fed(20.0, drift=0.0)
    before = clock.here(20.0)
    for k in range(200):
        assert clock.add(20.0 + k * 0.005, 50.0 + 20.0 + k * 0.005 + 0.2)
    assert clock.here(20.0) == pytest.approx(before, abs=1e-3)


def test_a_clock_that_is_set_is_noticed() -> None:
    clock = fed(20.0, drift=0.0)
    assert not clock.add(3.0, 50.0 + 20.01)
    assert clock.restarts == 1
    assert not clock.is_known


def test_a_clock_that_is_set_back_a_little_is_followed_after_some_seconds() -> None:
    clock = fed(20.0, drift=0.0)
    for k in range(2000):
        sent = 20.0 + k * 0.005
        clock.add(sent - 0.1, 50.0 + sent + 1e-4)
    assert clock.here(29.9) == pytest.approx(50.0 + 30.0, abs=1e-3)
