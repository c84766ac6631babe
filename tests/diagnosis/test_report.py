"""What the page of a diagnosis promises: it needs nothing beside it, and nothing in the data can spoil it."""

import errno
import math
import os
import re
from base64 import b64encode
from dataclasses import replace
from hashlib import sha256
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from cmr.diagnosis.report import report_of, write_report
from cmr.diagnosis.report.binned import MOST_SAMPLES
from cmr.diagnosis.report.pairs import pairs_of
from cmr.diagnosis.result import VERDICTS, Diagnosis, Fitted, NamedEffect, Path, Residual
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.estimation.unexplained.result import Unexplained
from cmr.recordings.faults.findings import Finding
from cmr.recordings.signal import Floats
from cmr.report.numbers import typeset
from tests.support.diagnosis_example import ALL, CANDIDATES, EFFECTS, FOUND, MOTION, RATE, STRANGE, path, residuals
from tests.support.html_page import Page


@pytest.mark.parametrize("verdict", VERDICTS)
def test_each_verdict_gives_a_page_that_begins_with_it(verdict: str) -> None:
    page, sentence = Page(report_of(ALL[verdict])), typeset(ALL[verdict].sentence)
    assert page.texts[0] == sentence
    assert page.open == []
    assert page.texts_of["h1"] == [sentence]


@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_page_needs_nothing_from_outside_and_runs_only_its_own_script(verdict: str) -> None:
    text = report_of(ALL[verdict])
    page = Page(text)
    loading = {"src", "href", "srcset", "data", "action", "background", "poster", "xlink:href"}
    assert not [e for e in page.elements if any(key.startswith("on") for key in e[1])]
    loaded = [str(e[1][key]) for e in page.elements for key in loading & set(e[1])]
    assert [target for target in loaded if not target.startswith("#")] == []
    assert not {"link", "iframe", "object", "embed", "form", "base"} & {name for name, _ in page.elements}
    assert not re.search(r"url\(|@import|https?:", text)
    assert page.named("script") == [{}]
    digest = b64encode(sha256(text.split("<script>")[1].split("</script>")[0].encode()).digest()).decode()
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    assert {"http-equiv": "Content-Security-Policy", "content": policy} in page.named("meta")


EVIL = "</style></svg><script>alert(1)</script><img src=x onerror=alert(1)>\"'&amp;"


def test_text_from_outside_cannot_become_markup() -> None:
    pair_of_evil = replace(residuals()[0], signal=EVIL, unit=EVIL, regressors={EVIL: MOTION.time})
    effect = replace(
        EFFECTS[0],
        name=EVIL,
        cause=EVIL,
        estimates={EVIL: Estimate(1.0, 0.1)},
        shift={EVIL: 0.1},
        indistinguishable_from=(EVIL,),
        next_experiment=f"{EVIL} `cmr-sim {EVIL}`",
    )
    diagnosis = replace(
        FOUND,
        verdict=EVIL,
        sentence=EVIL,
        effects=(effect,),
        candidates=(replace(CANDIDATES[0], name=EVIL, why_not=EVIL),),
        checks=(Finding(EVIL, 1, EVIL), Finding(EVIL, 0, EVIL)),
        notes=(EVIL,),
        next_experiment=EVIL,
        parameters={EVIL: 1.0},
        unexplained=Unexplained(present=True, signal=EVIL, regressors=(EVIL,), share=0.1),
        evidence=replace(FOUND.evidence, paths=(path(EVIL),), residuals=(pair_of_evil,)),
        sources=(EVIL,),
    )
    page, harmless = Page(report_of(diagnosis)), Page(report_of(FOUND))
    assert {name for name, _ in page.elements} <= {name for name, _ in harmless.elements}
    assert {key for _, attributes in page.elements for key in attributes} <= {
        key for _, attributes in harmless.elements for key in attributes
    }
    assert page.texts[0] == EVIL
    assert page.text.count("<script>") > 10


@pytest.mark.parametrize("verdict", VERDICTS)
def test_what_is_not_known_is_never_printed_as_a_number(verdict: str) -> None:
    unknown = Estimate(math.nan, math.nan)
    blank = Fitted(estimates={"k1": unknown}, path_rmse=math.nan, held_out_path_rmse=math.nan)
    lost = np.full(len(MOTION.time), math.nan)
    diagnosis = replace(
        ALL[verdict],
        baseline=blank,
        extended=blank,
        effects=(
            NamedEffect(
                name="slew_limit",
                cause="Slow.",
                estimates={"slew_limit": Estimate(math.inf, math.inf)},
                statistic=math.nan,
                p_value=math.nan,
                shift={"k1": math.nan},
            ),
        ),
        candidates=(replace(CANDIDATES[0], statistic=math.nan, p_value=math.nan, held_out=math.nan),),
        gain=Gain(ratio=math.nan, interval=(math.nan, math.nan), signals={"psi": math.nan}),
        unexplained=Unexplained(present=True, share=math.nan),
        parameters={"slew_limit": math.inf, "k1": math.nan},
        evidence=replace(
            FOUND.evidence,
            paths=(replace(path(), x=lost), replace(path(), before_x=lost, after_y=lost)),
            residuals=(
                replace(residuals()[0], before=np.full(len(MOTION.time), math.nan)),
                Residual(signal="heading", unit="rad", before=np.empty(0), after=np.empty(0), regressors={}),
                Residual(
                    signal="forward", unit="m", before=np.ones(1), after=np.ones(1), regressors={"time": np.zeros(1)}
                ),
            ),
        ),
    )
    assert not re.search(r"\b(nan|None|inf)\b", report_of(diagnosis))


def test_a_diagnosis_without_anything_still_gives_a_page() -> None:
    for verdict in VERDICTS:
        assert Page(report_of(Diagnosis(robot_id=0, verdict=verdict, sentence="So it is."))).texts[0] == "So it is."


@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_page_is_made_without_a_warning(verdict: str, recwarn: pytest.WarningsRecorder) -> None:
    report_of(ALL[verdict])
    assert [str(warning.message) for warning in recwarn] == []


@pytest.mark.slow
def test_hours_of_data_still_make_a_page_that_can_be_mailed() -> None:
    def longer(values: Floats) -> Floats:
        return np.tile(values, 240)  # four hours

    time = np.arange(240 * len(MOTION.time)) / RATE
    regressors = {name: longer(values) for name, values in MOTION.regressors.items()} | {"time": time}
    many = tuple(
        replace(
            r,
            before=longer(r.before),
            after=longer(r.after),
            regressors=regressors,
            without={name: longer(values) for name, values in r.without.items()},
        )
        for r in residuals()
    )
    others = ("label", "time", "piece", "pieces")
    fields: dict[str, Any] = {n: longer(values) for n, values in vars(path()).items() if n not in others}
    run = Path(label="long.lcm", time=time, **fields)
    assert all(len(pair.before) == MOST_SAMPLES for pair in pairs_of(many))  # the work does not grow
    page = report_of(replace(FOUND, evidence=replace(FOUND.evidence, paths=(run,) * 4, pieces=20, residuals=many)))
    assert len(page) < 2_000_000
    assert "The drives were cut into 20 pieces" in page


def test_a_report_is_written_as_it_is(tmp_path: FilePath) -> None:
    write_report(FOUND, tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == report_of(FOUND)


@pytest.mark.slow
def test_a_disk_that_fails_leaves_the_old_report_and_no_litter(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    write_report(FOUND, tmp_path / "report.html")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_report(STRANGE, tmp_path / "report.html")
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == report_of(FOUND)
