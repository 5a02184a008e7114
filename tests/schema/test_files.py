"""Files appear whole or not at all, and nothing is written over unasked."""

import os
from pathlib import Path

import pytest

from messages import refuses
from retarget.errors import UsageError
from retarget.schema.files import check_folder, check_place, refuse_existing, write_atomic, write_stream


def test_a_file_where_a_folder_is_meant(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "inside"):
        with refuses(UsageError, "--plots"):
            check_folder(folder, option="--plots")
    with refuses(UsageError):
        check_place(tmp_path, option="--report")


def test_a_file_is_on_the_disk_before_it_appears(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done, path = list[str](), tmp_path / "r.json"
    synced, renamed = os.fsync, Path.replace

    def sync(descriptor: int) -> None:
        done.append("synced")
        synced(descriptor)

    def rename(own: Path, place: Path) -> Path:
        done.append("renamed")
        return renamed(own, place)

    monkeypatch.setattr(os, "fsync", sync)
    monkeypatch.setattr(Path, "replace", rename)
    usual = os.umask(0o027)
    try:
        write_atomic(path, b"new", option="--report")
    finally:
        os.umask(usual)
    assert done == ["synced", "renamed"] and path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == 0o640


def test_what_cannot_be_written_leaves_the_file_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "r.json"
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with refuses(UsageError):
        write_stream(path, full, option="--report")
    monkeypatch.setattr(Path, "replace", full)
    with refuses(UsageError):
        write_atomic(path, b"new", option="--report")
    assert path.read_text() == "old" and len(list(tmp_path.iterdir())) == 1


def test_a_link_that_leads_nowhere_is_something(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with refuses(UsageError, "--overwrite"):
        refuse_existing(tmp_path / "link", option="--record")
    refuse_existing(tmp_path / "free", option="--record")
