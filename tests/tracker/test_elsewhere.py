"""Of two programs that publish poses of the same robot, the one that came later yields."""

from cmr.tracker.elsewhere import FIRST_LOOK, GONE, Elsewhere


class Heard:
    """What other programs publish: robots by number, handed over once."""

    def __init__(self) -> None:
        self.robots: set[int] = set()

    def __call__(self) -> set[int]:
        robots, self.robots = self.robots, set()
        return robots


def test_robots_that_have_poses_already_are_left_to_the_other_program_until_it_stops() -> None:
    heard = Heard()
    elsewhere = Elsewhere(heard, [0, 1])
    elsewhere.look(100.0)
    assert not elsewhere.is_decided
    heard.robots = {1}
    elsewhere.look(100.0 + FIRST_LOOK)
    assert elsewhere.is_decided
    assert elsewhere.yielded == {1}
    assert elsewhere.problem() == (
        "Another program publishes poses of robot 1: only one may; these are not published here."
    )
    elsewhere.look(100.0 + FIRST_LOOK + 0.9 * GONE)
    assert elsewhere.yielded == {1}
    elsewhere.look(100.0 + FIRST_LOOK + 1.1 * GONE)
    assert elsewhere.yielded == set()
    assert elsewhere.problem() == ""


def test_a_program_that_comes_later_is_reported_and_does_not_stop_this_one() -> None:
    heard = Heard()
    elsewhere = Elsewhere(heard, [0, 1, 2])
    elsewhere.look(100.0)
    elsewhere.look(100.0 + FIRST_LOOK)
    heard.robots = {1}
    elsewhere.look(110.0)
    assert elsewhere.others == {1}
    assert elsewhere.yielded == set()
    assert elsewhere.problem() == "Another program publishes poses of robot 1: only one may."


def test_where_one_robot_was_left_to_another_program_and_one_was_not_the_sentence_says_which() -> None:
    heard = Heard()
    elsewhere = Elsewhere(heard, [0, 1])
    heard.robots = {1}
    elsewhere.look(100.0)
    heard.robots = {1}
    elsewhere.look(100.0 + FIRST_LOOK)
    heard.robots = {0, 1}
    elsewhere.look(102.0)
    assert elsewhere.problem() == (
        "Another program publishes poses of robot 0, 1: only one may; those of 1 are not published here."
    )


def test_robots_that_are_not_in_the_profile_do_not_count() -> None:
    heard = Heard()
    elsewhere = Elsewhere(heard, [0, 1])
    heard.robots = {7}
    elsewhere.look(100.0)
    elsewhere.look(100.0 + FIRST_LOOK)
    assert elsewhere.others == set()
