"""Where configurations are found, which one wins, and how unknown names are refused."""

import os
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from messages import Facts, refuses
from planted import failing
from retarget.errors import ConfigError, UsageError
from retarget.schema.catalogue import Kind, entries, find
from retarget.schema.files import check_folder, check_place, refuse_existing, write_atomic, write_folder, write_stream
from retarget.schema.performer import load_performer
from retarget.schema.priorities import load_priorities
from retarget.schema.scene import load_scene


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


def test_the_users_own_are_found_by_name_and_path_and_hide_the_shipped(own: Path, tmp_path: Path) -> None:
    for name in ("mine", "op3"):
        mine = put(own, Kind.ROBOT, name)
        assert find(Kind.ROBOT, name) == mine
    shipped = {entry.name: entry.shipped for entry in entries(Kind.ROBOT)}
    assert (shipped.pop("mine"), shipped.pop("op3")) == (False, False)
    assert shipped and all(shipped.values())
    path = put(tmp_path / "elsewhere", Kind.ROBOT, "r")
    assert find(Kind.ROBOT, path) == find(Kind.ROBOT, str(path.parent)) == path
    file = put(tmp_path / "elsewhere", Kind.PRIORITIES, "p")
    assert find(Kind.PRIORITIES, str(file)) == file
    with refuses(UsageError):
        find(Kind.ROBOT, tmp_path)  # a folder without a robot


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


# Files appear whole or not at all, and nothing is written over unasked.


def test_a_file_where_a_folder_is_meant(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "inside"):
        with refuses(UsageError, "--plots"):
            check_folder(folder, option="--plots")
    with refuses(UsageError):
        check_place(tmp_path, option="--report")


def test_a_link_that_leads_nowhere_is_something(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with refuses(UsageError, "--overwrite"):
        refuse_existing(tmp_path / "link", option="--record")
    refuse_existing(tmp_path / "free", option="--record")


def test_a_file_is_on_the_disk_before_it_appears(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done, path = list[str](), tmp_path / "r.json"

    def noted(name: str, real: Callable[..., object]) -> Callable[..., object]:
        def called(*arguments: object) -> object:
            done.append(name)
            return real(*arguments)

        return called

    monkeypatch.setattr(os, "fsync", noted("synced", os.fsync))
    monkeypatch.setattr(Path, "replace", noted("renamed", Path.replace))
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
    full = Mock(side_effect=OSError(28, "No space left on device"))
    with refuses(UsageError):
        write_stream(path, full, option="--report")
    monkeypatch.setattr(Path, "replace", full)
    with refuses(UsageError):
        write_atomic(path, b"new", option="--report")
    assert path.read_text() == "old" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("step", range(1, 4))
@pytest.mark.parametrize("after", [False, True])
def test_an_interrupt_leaves_the_old_folder_or_the_new(
    step: int, after: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, steps = tmp_path / "set", count(1)
    write_folder(path, {"meta/a": b"old", "b": b"old"}, option="--out")

    def interrupted(real: Callable[..., object]) -> Callable[..., object]:
        def called(*arguments: Any) -> object:
            now = next(steps) == step
            if now and not after:
                raise KeyboardInterrupt
            result = real(*arguments)
            if now:
                raise KeyboardInterrupt
            return result

        return called

    monkeypatch.setattr(os, "fsync", interrupted(os.fsync))
    monkeypatch.setattr(Path, "replace", interrupted(Path.replace))
    with pytest.raises(KeyboardInterrupt):
        write_folder(path, {"c": b"new"}, option="--out")
    kept = {file.relative_to(tmp_path).as_posix(): file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    new = step == 3 and after
    assert kept == ({"set/c": b"new"} if new else {"set/meta/a": b"old", "set/b": b"old"})
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_cannot_be_put_back_is_kept_beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "set"
    write_folder(path, {"a": b"old"}, option="--out")
    monkeypatch.setattr(Path, "replace", failing(Path.replace, OSError(5, "Input/output error"), range(2, 9)))
    with refuses(UsageError, "--out"):
        write_folder(path, {"a": b"new"}, option="--out")
    assert [file.read_bytes() for file in tmp_path.rglob("old/a")] == [b"old"]


LOADERS = {Kind.PRIORITIES: load_priorities, Kind.PERFORMER: load_performer, Kind.SCENE: load_scene}


@pytest.mark.parametrize(
    ("given", "wanted"), [(given, wanted) for given in (Kind.ROBOT, *LOADERS) for wanted in LOADERS if given != wanted]
)
def test_a_file_of_another_kind_is_one_problem(given: Kind, wanted: Kind) -> None:
    path = next(entry.path for entry in entries(given) if entry.shipped)
    with refuses(ConfigError, given.label, wanted.label, where=path.name):
        LOADERS[wanted](path)


def test_a_file_with_a_key_of_its_own_kind_has_its_problems_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\ndescription: mine\npartial: true\nobstacles: {}\n", encoding="utf-8")
    for where in ("sensors", "obstacles"):
        with refuses(ConfigError, where=where):
            load_performer(path)
