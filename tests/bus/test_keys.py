"""The file of the key: made so that its owner alone can read it, and refused where others can, or where it is none."""

import os
import stat
from pathlib import Path

import pytest

from cmr.bus.keys import KeyFileError, key_in_use, read_key, shown, write_new_key
from cmr.bus.signing import KEY_BYTES


def test_a_key_is_read_as_it_was_made_and_nobody_else_can_read_it(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "key"
    key = write_new_key(path)
    assert read_key(path) == key
    assert len(key) == KEY_BYTES
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert key.hex() not in shown(key)
    assert list(path.parent.iterdir()) == [path]


def test_a_key_that_is_there_is_replaced_only_where_that_is_asked_for(tmp_path: Path) -> None:
    key = write_new_key(tmp_path / "key")
    with pytest.raises(KeyFileError, match="--replace"):
        write_new_key(tmp_path / "key")
    assert read_key(tmp_path / "key") == key
    assert write_new_key(tmp_path / "key", replace=True) != key


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660])
def test_a_key_that_others_can_read_is_refused_with_what_to_do(tmp_path: Path, mode: int) -> None:
    write_new_key(tmp_path / "key")
    (tmp_path / "key").chmod(mode)
    with pytest.raises(KeyFileError, match="chmod 600"):
        read_key(tmp_path / "key")


@pytest.mark.parametrize("text", ["", "secret", "00" * 31, "00" * 33, "ä" * 64, "0" * 2000])
def test_what_is_no_key_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "key").touch(0o600)
    (tmp_path / "key").write_text(text)
    with pytest.raises(KeyFileError, match=str(tmp_path)):
        read_key(tmp_path / "key")


def test_what_cannot_be_read_is_refused_and_does_not_hold_up(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    for path in (tmp_path / "pipe", tmp_path / "missing"):
        with pytest.raises(KeyFileError, match="cannot be read"):
            read_key(path)


def test_a_key_is_not_needed_but_where_one_is_named_it_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert key_in_use() is None
    (tmp_path / "cmr").mkdir()
    key = write_new_key(tmp_path / "cmr" / "key")
    assert key_in_use() == key
    monkeypatch.setenv("CMR_KEY", str(tmp_path / "missing"))
    with pytest.raises(KeyFileError, match="missing"):
        key_in_use()
