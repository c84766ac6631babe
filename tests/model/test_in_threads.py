"""Work in two threads: all of it is done, and what fails is reported."""

import os

import pytest

from cmr.model.observer.observer import in_two_threads


@pytest.mark.parametrize("cores", [{0}, {0, 1}])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_each_number_is_worked_on_once(monkeypatch: pytest.MonkeyPatch, cores: set[int], count: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: cores)
    done: list[int] = []
    in_two_threads(lambda first, last: done.extend(range(first, last)), count)
    assert sorted(done) == list(range(count))


def test_what_fails_in_the_second_thread_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {0, 1})

    def work(first: int, _last: int) -> None:
        if first > 0:
            raise MemoryError("too many candidates")

    with pytest.raises(MemoryError, match="too many candidates"):
        in_two_threads(work, 4)
