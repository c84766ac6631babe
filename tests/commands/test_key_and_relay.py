"""`cmr key` makes the key of the bus, `cmr relay` signs for programs that have none, `cmr doctor` looks after both."""

from pathlib import Path

import pytest

from cmr.bus.bus import Bus
from cmr.bus.keys import read_key, shown, write_new_key
from cmr.bus.messages import make, now_utime
from cmr.bus.process import Process
from cmr.bus.streams import MOTOR_COMMAND, POSE
from cmr.cli.errors import CommandError
from cmr.commands import doctor, key, relay
from cmr.msg import motor_command_t, pose_xyt_t

SHARED = "udpm://239.255.76.67:7667?ttl=1"
PATIENCE = 5.0  # s


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where this user's key would be."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "cmr" / "key"


def test_a_key_is_made_once_and_shown_by_what_nobody_can_make_it_from(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(CommandError, match="cmr key new"):
        key.main([])
    assert key.main(["new"]) == 0
    assert key.main([]) == 0
    made = read_key(path)
    said = capsys.readouterr().out
    assert said.count(shown(made)) == 2
    assert made.hex() not in said


def test_the_doctor_says_whether_others_could_drive_the_robots(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.key("udpm://239.255.76.67:7667?ttl=0").colour == doctor.GREEN
    assert doctor.key(SHARED).colour == doctor.RED
    with monkeypatch.context() as insecure:
        insecure.setenv("CMR_INSECURE", "1")
        assert doctor.key(SHARED).colour == doctor.AMBER
    made = write_new_key(path)
    assert shown(made) in doctor.key(SHARED).sentence
    path.chmod(0o644)
    assert doctor.key(SHARED) == (doctor.RED, *doctor.key(SHARED)[1:])
    assert "chmod 600" in " ".join(doctor.key(SHARED)[1:])


def test_a_relay_signs_what_it_is_for_and_nothing_else(path: Path, url: str) -> None:
    write_new_key(path)
    with Process("cmr relay", url) as process:
        listener = Bus(url)
        listener.subscribe(POSE, every=True)
        listener.subscribe(MOTOR_COMMAND, every=True)
        handing_on = relay.Relay(process, ["POSE_*"])
        pose = make(pose_xyt_t, utime=now_utime(), robot_id=2, x=1.0, y=2.0, theta=0.5)
        command = make(motor_command_t, utime=now_utime(), robot_id=2, left=1.0, right=1.0)
        handing_on.take("POSE_2", pose.encode())
        handing_on.take("POSE_3", pose.encode())
        handing_on.take("POSE_2", b"junk")
        handing_on.take("MOTOR_COMMAND_2", command.encode())
        [received] = listener.receive(PATIENCE)
    assert received.message.encode() == pose.encode()
    assert not listener.rejected
    assert handing_on.rejected == {
        ("POSE_3", "wrong_robot"): 1,
        ("POSE_2", "foreign"): 1,
        ("MOTOR_COMMAND_2", "not_chosen"): 1,
    }
    assert handing_on.sentence().startswith("1 messages handed on. Not handed on: ")
