"""Where configurations are found, which one wins, and how unknown names are refused."""

from pathlib import Path

import pytest

from messages import Facts, refuses
from retarget.errors import UsageError
from retarget.schema.catalogue import Kind, entries, find, kind_of


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "retarget"


def put(folder: Path, kind: Kind, name: str) -> Path:
    path = folder / kind.value / name / "robot.yaml" if kind is Kind.ROBOT else folder / kind.value / f"{name}.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("name: x\n", encoding="utf-8")
    return path


def test_the_users_own_are_found_and_hide_the_shipped(own: Path) -> None:
    mine = put(own, Kind.ROBOT, "mine")
    op3 = put(own, Kind.ROBOT, "op3")
    assert find(Kind.ROBOT, "mine") == mine
    assert find(Kind.ROBOT, "op3") == op3
    shipped = {entry.name: entry.shipped for entry in entries(Kind.ROBOT)}
    assert (shipped.pop("mine"), shipped.pop("op3")) == (False, False)
    assert shipped and all(shipped.values())


def test_paths(own: Path, tmp_path: Path) -> None:
    path = put(tmp_path / "elsewhere", Kind.ROBOT, "r")
    assert find(Kind.ROBOT, path) == path
    assert find(Kind.ROBOT, str(path.parent)) == path.parent / "robot.yaml"
    file = put(tmp_path / "elsewhere", Kind.PRIORITIES, "p")
    assert find(Kind.PRIORITIES, str(file)) == file


@pytest.mark.parametrize(
    ("kind", "name", "part"),
    [
        (Kind.ROBOT, "op33", ("'op33'", "op3")),
        (Kind.ROBOT, "humn", ("op3", "human")),
        (Kind.PERFORMER, "sixx", "six"),
        (Kind.PERFORMER, "", ()),
        (Kind.SCENE, "tabel", ("'tabel'", "table")),
        (Kind.SCENE, "gone.yaml", "gone.yaml"),
        (Kind.ROBOT, "some/where", "some/where"),
        (Kind.PERFORMER, "gone.yaml", "gone.yaml"),
        (Kind.PERFORMER, "/", ()),
        (Kind.PERFORMER, "a\0b", ()),
        (Kind.PERFORMER, "x" * 5000, ()),
        (Kind.PERFORMER, "x" * 5000 + ".yaml", ()),
        (Kind.PERFORMER, "~no_user_of_that_name/x.yaml", ()),
    ],
)
def test_unknown_names_and_paths_are_refused(own: Path, kind: Kind, name: str, part: Facts) -> None:
    with refuses(UsageError, part) as caught:
        find(kind, name)
    assert len(str(caught.value)) < 1500


def test_a_folder_without_a_robot_is_refused(own: Path, tmp_path: Path) -> None:
    with refuses(UsageError):
        find(Kind.ROBOT, tmp_path)


def test_kind_by_folder(tmp_path: Path) -> None:
    assert kind_of(tmp_path / "priorities" / "a.yaml") is Kind.PRIORITIES
    assert kind_of(tmp_path / "robots" / "r" / "robot.yaml") is Kind.ROBOT
    assert kind_of(tmp_path / "scenes" / "a.yaml") is Kind.SCENE
    assert kind_of(tmp_path / "a.yaml") is None
