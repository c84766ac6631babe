"""What cmr-view says of options that it cannot take."""

import pytest

from cmr.cli.errors import CommandError
from cmr.commands.view import main


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--host", "0.0.0.0"], "--token"),
        (["--token", "short"], "8 characters"),
        (["--allow-host", "robots.lab"], "--token"),
        (["--key", "lab.key"], "--certificate"),
        (["--certificate", "/nowhere.pem"], "No such file"),
        (["--geofence=0,0,1,1"], "3 corners"),
        (["--geofence=0,0,1"], "3 numbers are no points of x and y"),
        (["--obstacle", "1,2"], "--obstacle"),
        (["--scenario", "/nowhere.yaml"], "nowhere"),
    ],
)
def test_what_cannot_be_is_said_in_a_sentence(arguments: list[str], says: str) -> None:
    with pytest.raises(CommandError, match=says):
        main(arguments)
