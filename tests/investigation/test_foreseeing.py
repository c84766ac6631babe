"""What is foreseen to show: closed forms of effects that show steadily, and of such that drift."""

import pytest

from cmr.investigation.foreseeing import Growth


def grown(exponent: float, rate: float = 0.0) -> Growth:
    """Return the growth of an effect that shows with a power of time, noted each second until 20 s."""
    growth = Growth({"slope": rate})
    for second in range(1, 21):
        growth.note(float(second), {"slope": 1e-3 * second**exponent}, ())
    return growth


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0])
def test_what_shows_with_a_power_of_time_is_foreseen_to_go_on_with_it(exponent: float) -> None:
    """Thrice as long shows 3^p times as much."""
    assert grown(exponent).foreseen("slope", 60.0) == pytest.approx(1e-3 * 60.0**exponent, rel=0.01)


def test_movements_that_show_more_are_counted_on() -> None:
    """Of what shows steadily, 2 a second from 20 s on are 80 more at 60 s."""
    assert grown(1.0, rate=2.0).foreseen("slope", 60.0) == pytest.approx(0.02 + 80.0)


def test_what_was_seen_beside_other_names_tells_nothing() -> None:
    """After a name the fastest growth is possible until there are times to compare."""
    growth = grown(1.0)
    growth.note(21.0, {"slope": 1.0}, ("gyro_bias",))
    assert growth.foreseen("slope", 42.0) == pytest.approx(8.0)
