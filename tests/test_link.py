"""The link by which clients know a line: made, moved and taken away without touching what is not ours."""

import os
import socket
from pathlib import Path

import pytest

from retarget.errors import UsageError
from sim.emulator.link import Link
from support.messages import refuses


def test_it_is_made_moved_and_taken_away(tmp_path: Path) -> None:
    link = Link(tmp_path / "servos")
    for target in ("/dev/pts/71", "/dev/pts/72"):
        link.point(target)
        assert link.path.readlink() == Path(target)
        assert list(tmp_path.iterdir()) == [link.path]
    link.remove()
    link.remove()
    assert list(tmp_path.iterdir()) == []


def test_what_an_emulator_left_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "servos"
    path.symlink_to("/dev/pts/99999")
    Link(path).point("/dev/pts/3")
    assert path.readlink() == Path("/dev/pts/3")


def test_a_link_that_somebody_moved_stays(tmp_path: Path) -> None:
    link = Link(tmp_path / "servos")
    link.point("/dev/pts/71")
    link.path.unlink()
    link.path.symlink_to("/dev/pts/72")
    link.remove()
    assert link.path.readlink() == Path("/dev/pts/72")


def test_the_link_of_a_living_emulator_is_left_to_it(tmp_path: Path) -> None:
    first, second = Link(tmp_path / "servos"), Link(tmp_path / "servos")
    first.point("/dev/pts/71")
    for refused in (second.check, lambda: second.point("/dev/pts/72")):
        with refuses(UsageError, found=os.getpid()):
            refused()
    second.remove()
    assert first.path.readlink() == Path("/dev/pts/71")
    first.remove()
    second.point("/dev/pts/72")
    assert second.path.readlink() == Path("/dev/pts/72")


def test_a_link_that_is_hidden_is_still_of_its_emulator(tmp_path: Path) -> None:
    first, second = Link(tmp_path / "servos"), Link(tmp_path / "servos")
    first.point("/dev/pts/71")
    first.hide()
    assert list(tmp_path.iterdir()) == []
    with refuses(UsageError):
        second.check()
    first.point("/dev/pts/73")
    assert first.path.readlink() == Path("/dev/pts/73")


def test_where_no_path_can_be_kept_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> socket.socket:
        raise OSError(97, "Address family not supported by protocol")

    monkeypatch.setattr(socket, "socket", none)
    with refuses(UsageError):
        Link(tmp_path / "servos").check()


@pytest.mark.parametrize("kind", ["file", "folder", "link", "dangling"])
def test_nothing_else_is_ever_replaced(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "servos"
    if kind == "file":
        path.write_text("mine")
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/null" if kind == "link" else tmp_path / "nowhere")
    before = path.lstat()
    with refuses(UsageError):
        Link(path).point("/dev/pts/3")
    assert path.lstat() == before


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with refuses(UsageError):
        Link(tmp_path / "none" / "servos").check()
