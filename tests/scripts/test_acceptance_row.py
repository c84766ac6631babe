"""A report of cmr accept becomes a row of the table of what was tried."""

import runpy
from typing import Any

import pytest

from tests.support.project import PROJECT

SCRIPT = runpy.run_path(str(PROJECT / "scripts" / "write_acceptance_row"))
REPORT: dict[str, Any] = {
    "device": "USB Roboclaw 2x30a v4.2.4",
    "controller": "roboclaw",
    "port": "/dev/serial/by-id/usb-Basicmicro_RoboClaw-if00",
    "host": "lab | aarch64",
    "kernel": "Linux 6.6",
    "utime": 1_790_000_000_000_000,
    "short": False,
    "promises": [
        {"number": 1, "verdict": "passed"},
        {"number": 2, "verdict": "failed"},
        {"number": 3, "verdict": "not tried"},
        {"number": 4, "verdict": "passed"},
    ],
}


def test_a_report_is_a_row_whose_cells_stay_cells() -> None:
    row = SCRIPT["row"](REPORT, "a lab")
    cells = [cell.strip() for cell in row.strip().strip("|").split("|")]
    assert cells == [
        "roboclaw: USB Roboclaw 2x30a v4.2.4",
        "lab / aarch64, Linux 6.6",
        "2026-09-21",
        "1, 4",
        "2",
        "3",
        "a lab",
    ]


def test_rows_are_put_below_those_of_before_and_the_table_is_no_longer_called_empty() -> None:
    page = (PROJECT / "docs" / "measurements" / "acceptance.md").read_text("utf-8")
    once = SCRIPT["with_rows"](page, ["| first |\n"])
    assert SCRIPT["HEADER"] + "| first |\n" in once
    assert "table is empty" not in once
    with pytest.raises(ValueError, match="no table"):
        SCRIPT["with_rows"]("# Another page\n", ["| first |\n"])


@pytest.mark.parametrize("port", ["/dev/pts/7", "/tmp/ports/motor"])
def test_an_emulated_device_is_no_real_one(port: str) -> None:
    with pytest.raises(ValueError, match="emulated"):
        SCRIPT["row"](REPORT | {"port": port}, "a lab")
