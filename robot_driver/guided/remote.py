"""Steps on a page: lines of JSON to and from the page's server.

Out: `{"step": 3, "kind": "question", "text": "...", "choices": [["yes", "..."]], "unit": "", "seconds": 0}`, then
`{"progress": 0.5, "text": "..."}`, `{"refused": "..."}`, `{"over": "..."}`, and during a motion `{"beat": 7}`. In:
`{"step": 3, "answer": "yes"}` and `{"beat": 7}`, which a page echoes at once. If a page has not echoed a beat for
SILENCE, the motion ends, as with any answer.
"""

import json
import os
import time
from collections.abc import Callable

from robot_driver.guided.guide import Left
from robot_driver.guided.steps import Kind, Step

SILENCE, BEAT_PERIOD = 0.5, 0.1  # s
PROGRESS_PERIOD = 0.1  # s
MOST_READ = 65_536  # bytes at once
MOST_BEATS = 100  # kept
LONGEST_LINE = 2000  # bytes of a message of the page
MOST_WAITING = 1_000_000  # bytes not yet written
GONE = "The page is closed: nobody can answer or stop a motion any more."
SILENT = "the page does not answer"


class Remote:
    """A front on a page, behind two non-blocking file descriptors; a page may be silent for `silence` seconds."""

    def __init__(
        self, source: int = 0, output: int = 1, clock: Callable[[], float] = time.monotonic, silence: float = SILENCE
    ) -> None:
        self._source, self._output, self._clock, self._silence = source, output, clock, silence
        self._step: Step | None = None
        self._number, self._answer = 0, ""
        self._is_answered = False
        self._rest, self._waiting = b"", b""
        self._beats: dict[int, float] = {}  # when each was sent (s)
        self._heard = self._beat_due = self._progress_due = 0.0
        for file in (source, output):
            os.set_blocking(file, False)

    def show(self, step: Step) -> None:
        """Send a step; answers to earlier steps are ignored."""
        self._step, self._is_answered = step, False
        self._number += 1
        self._heard = self._clock()
        self._say(
            step=self._number,
            kind=step.kind.name.lower(),
            text=step.text,
            choices=[[choice.key, choice.text] for choice in step.choices],
            unit=step.unit,
            seconds=step.seconds,
        )

    def progress(self, fraction: float, text: str) -> None:
        """Send the progress of the step, now and then."""
        if self._clock() >= self._progress_due:
            self._progress_due = self._clock() + PROGRESS_PERIOD
            self._say(progress=round(fraction, 3), text=text)

    def answer(self) -> str | None:
        """Return the answer given on the page, or that it is silent during a motion. Raises Left."""
        self._take()
        if self._step is None or self._step.kind is Kind.NOTE:
            return None
        now = self._clock()
        if self._step.kind is Kind.MOTION:
            if now >= self._beat_due:
                self._beat(now)
            if now - self._heard > self._silence:
                return SILENT
        if not self._is_answered:
            return None
        self._is_answered = False
        return self._answer

    def refuse(self, problem: str) -> None:
        """Send why the answer was refused."""
        self._say(refused=problem)

    def dismiss(self, answer: str) -> None:
        """Send that the step is over."""
        self._step = None
        self._say(over=answer)

    def _beat(self, now: float) -> None:
        self._beat_due = now + BEAT_PERIOD
        number = max(self._beats, default=0) + 1
        self._beats[number] = now
        self._beats.pop(number - MOST_BEATS, None)
        self._say(beat=number)

    def _take(self) -> None:
        """Process the messages of the page. Raises Left if it is closed."""
        self._flush()
        try:
            data = os.read(self._source, MOST_READ)
        except BlockingIOError:
            return
        except OSError as error:
            raise Left(GONE) from error
        if not data:
            raise Left(GONE)
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-LONGEST_LINE:]
        for line in lines:
            self._hear(line)

    def _hear(self, line: bytes) -> None:
        try:
            said = json.loads(line)
        except (ValueError, RecursionError):
            return
        if not isinstance(said, dict):
            return
        step, answer, beat = (said.get(name) for name in ("step", "answer", "beat"))
        if isinstance(beat, int) and beat in self._beats:
            self._heard = max(self._heard, self._beats[beat])
        if step == self._number and isinstance(answer, str):
            self._answer, self._is_answered = answer.strip(), True

    def _say(self, **what: object) -> None:
        self._waiting += json.dumps(what).encode() + b"\n"
        self._flush()

    def _flush(self) -> None:
        """Write as much as possible. Raises Left if the reader is gone."""
        try:
            if self._waiting:
                self._waiting = self._waiting[os.write(self._output, self._waiting) :]
        except BlockingIOError:
            pass
        except OSError as error:
            raise Left(GONE) from error
        if len(self._waiting) > MOST_WAITING:
            raise Left(GONE)
