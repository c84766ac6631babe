"""The report as a page. It is not part of the driver's package for robots, which has no module for pages."""

import time

from cmr.report.markup import Html, joined, tag
from cmr.report.page import page_of
from cmr.report.section import paragraph, quiet, section
from cmr.report.table import table
from robot_driver.acceptance.findings import FAILED, NOT_TRIED, PROMISES
from robot_driver.acceptance.report import Report

SHORT = "This was the short form, which takes minutes instead of half an hour and shows less."


def page(report: Report) -> str:
    """Return the report as HTML that needs no other file."""
    day = time.strftime("%Y-%m-%d %H:%M", time.gmtime(report.utime / 1e6))
    title = f"Acceptance: {report.device}"
    header = tag("header", tag("h1", title), tag("p", f"{day} UTC, CMR {report.cmr}"))
    lead = joined(paragraph(report.summary), quiet(SHORT) if report.short else Html(""))
    sections = (
        section("Promises", _promises(report)),
        section("What failed", _of(report, FAILED)),
        section("What was not tried", _of(report, NOT_TRIED)),
        section("Checks", _checks(report)),
        section("Figures", _figures(report)),
        section("Device and computer", _about(report)),
    )
    return page_of(title, header, lead, sections)


def _promises(report: Report) -> Html:
    rows = [(str(number), PROMISES[number], word) for number, word in report.verdicts.items()]
    return table(("number", "promise", "result"), rows)


def _of(report: Report, word: str) -> Html:
    """Return the checks with one result; empty without any."""
    rows = [(str(one.promise), one.check, one.said) for one in report.findings if one.verdict == word]
    return table(("promise", "check", "what was seen"), rows) if rows else Html("")


def _checks(report: Report) -> Html:
    rows = [(str(one.promise), one.check, one.verdict, one.said) for one in report.findings]
    return table(("promise", "check", "result", "what was seen"), rows)


def _figures(report: Report) -> Html:
    rows = [(name.replace("_", " "), f"{value:.4g}") for name, value in report.figures.items()]
    return table(("figure", "value"), rows, numbers=(1,)) if rows else Html("")


def _about(report: Report) -> Html:
    rows = [
        ("device", report.device),
        ("controller", report.controller),
        ("gyro", report.gyro or "none"),
        ("port", report.port),
        ("host", report.host),
        ("kernel", report.kernel),
        ("Python", report.python),
        ("CMR", report.cmr),
        ("duty", f"{100 * report.duty:.0f} %"),
        ("took", f"{report.seconds / 60:.1f} min"),
    ]
    return table(("what", "value"), rows)
