"""The link by which clients know a line: made, moved and taken away without touching what is not ours."""

from pathlib import Path

import pytest

from retarget.errors import UsageError
from sim.emulator.link import Link


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
    first, second = Link(tmp_path / "servos"), Link(tmp_path / "servos")
    first.point("/dev/pts/71")
    second.point("/dev/pts/72")
    first.remove()
    assert second.path.readlink() == Path("/dev/pts/72")


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
    with pytest.raises(UsageError, match="taken"):
        Link(path).point("/dev/pts/3")
    assert path.lstat() == before


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such folder"):
        Link(tmp_path / "none" / "servos").check()
