"""Steps on a page, by the lines that go there and come back."""

import json
import os
from collections.abc import Iterator

import pytest

from robot_driver.guided import Choice, Guide, Left, Remote
from robot_driver.guided.remote import SILENCE, SILENT
from robot_driver.guided.steps import Kind, Step

QUESTION = Step("q", Kind.QUESTION, "Which?", (Choice("a", "the one"), Choice("b", "the other")))
MOTION = Step("m", Kind.MOTION, "It turns now.", seconds=1.0)


class Page:
    """The other end of a front, with a clock that the test advances."""

    def __init__(self) -> None:
        source, self.to_front = os.pipe()
        self.from_front, output = os.pipe()
        os.set_blocking(self.from_front, False)
        self.now = 0.0
        self.front = Remote(source, output, lambda: self.now)
        self._files = [source, output, self.from_front]

    def say(self, **what: object) -> None:
        os.write(self.to_front, json.dumps(what).encode() + b"\n")

    def heard(self) -> list[dict[str, object]]:
        try:
            return [json.loads(line) for line in os.read(self.from_front, 100_000).splitlines()]
        except BlockingIOError:
            return []

    def repeat_beats(self) -> None:
        for beat in [told["beat"] for told in self.heard() if "beat" in told]:
            self.say(beat=beat)

    def close(self) -> None:
        for file in self._files:
            os.close(file)


@pytest.fixture
def page() -> Iterator[Page]:
    page = Page()
    yield page
    page.close()


def test_a_step_goes_out_and_its_answer_comes_back(page: Page) -> None:
    page.front.show(QUESTION)
    assert page.front.answer() is None
    (told,) = page.heard()
    assert told == {
        **{"step": 1, "kind": "question", "text": "Which?", "unit": "", "seconds": 0.0},
        "choices": [["a", "the one"], ["b", "the other"]],
    }
    page.say(step=1, answer=" a ")
    assert page.front.answer() == "a"
    assert page.front.answer() is None


def test_what_was_answered_to_another_step_answers_nothing(page: Page) -> None:
    page.front.show(QUESTION)
    page.say(step=1, answer="a")
    page.front.show(QUESTION)
    assert page.front.answer() is None
    for nonsense in (b"\n", b"{\n", b"[1]\n", b'{"step": 2}\n', b'{"step": 2, "answer": 7}\n', b"\xff\n"):
        os.write(page.to_front, nonsense)
    assert page.front.answer() is None


def test_a_motion_ends_by_any_answer_and_where_the_page_is_silent(page: Page) -> None:
    page.front.show(MOTION)
    while page.now < 2.0:
        assert page.front.answer() is None
        page.repeat_beats()
        page.now += 0.05
    page.now += SILENCE + 0.1
    assert page.front.answer() == SILENT
    page.front.show(MOTION)
    page.say(step=2, answer="stop")
    assert page.front.answer() == "stop"


def test_beats_that_come_late_do_not_count_as_new(page: Page) -> None:
    page.front.show(MOTION)
    page.front.answer()
    (beat,) = [told["beat"] for told in page.heard() if "beat" in told]
    page.now += SILENCE + 0.01
    page.say(beat=beat)
    assert page.front.answer() == SILENT


def test_a_closed_page_ends_the_procedure(page: Page) -> None:
    page.front.show(MOTION)
    os.close(page.to_front)
    with pytest.raises(Left, match="closed"):
        page.front.answer()


def test_a_guide_asks_on_a_page_until_the_answer_can_be_taken(page: Page) -> None:
    answers = [{"step": 1, "answer": "seven"}, {"step": 1, "answer": "12.5"}]
    guide = Guide(page.front, lambda _seconds: page.say(**answers.pop(0)))
    assert guide.number("n", "How large?", "mm", 1.0, 100.0) == 12.5
    told = page.heard()
    assert [next(iter(one)) for one in told] == ["step", "refused", "over"]
    assert "from 1 to 100" in str(told[1])
