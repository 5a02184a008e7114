"""From a body file to a profile that runs: whole or not at all, and with no line of hand work."""

import json
from pathlib import Path

import pytest

from messages import refuses, shows
from retarget.cli import main
from retarget.errors import InputError, UsageError
from retarget.ik.support_polygon import check_stand
from retarget.model.robot import load_profile, load_robot
from retarget.setup.import_robot import Imported, import_robot
from unknown_robots import SHIPPED, humanoid, scrambled, shipped_body, small_bust, table_arm


def imported(text: str, folder: Path, *, samples: int = 30, suffix: str = "urdf") -> Imported:
    path = folder / f"body.{suffix}"
    path.write_text(text, encoding="utf-8")
    return import_robot(path, folder / "new", samples=samples)


def left_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_bust(tmp_path: Path) -> None:
    done = imported(small_bust(), tmp_path)
    assert not done.problems and done.margin is None and done.drafts == 4 + 5
    assert left_in(tmp_path) == {"body.urdf", "new"} and left_in(done.folder) == {"robot.yaml", "body.xml"}
    profile = load_profile(done.folder)
    arms = {f"{side}_{part}" for side in "lr" for part in ("hand", "upper_arm", "forearm")}
    assert (profile.name, profile.root, set(profile.landmarks)) == ("stranger", "fixed", {*arms, "head"})
    assert set(profile.servos) == {"j_p1", "j_p2", "j_q1", "j_q2"} and not profile.feet


def test_the_missing_parts_of_an_arm_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "body.urdf"
    path.write_text(table_arm())
    done = import_robot(path, tmp_path / "new", name="op3", samples=10)
    assert done.draft.notes[0].startswith("a robot op3 is known already")
    assert [text.split(":")[0] for text in done.draft.missing] == ["head", "legs", "l_hand"]
    assert len(done.problems) == 1 and str(tmp_path) not in done.problems[0]
    shows(done.problems[0], "l_hand")
    assert "# Not found: l_hand: no such arm." in (done.folder / "robot.yaml").read_text()


def test_a_robot_without_shapes(tmp_path: Path) -> None:
    text = small_bust()
    while "<collision>" in text:
        text = text[: text.index("<collision>")] + text[text.index("</collision>") + len("</collision>") :]
    done = imported(text, tmp_path)
    shows(done.draft.notes)
    assert not load_profile(done.folder).observers


@pytest.mark.parametrize("kind", ["folder", "file", "link"])
def test_nothing_is_overwritten(kind: str, tmp_path: Path) -> None:
    target = tmp_path / "new"
    if kind == "folder":
        target.mkdir()
        (target / "robot.yaml").write_text("mine")
    elif kind == "file":
        target.write_text("mine")
    else:
        target.symlink_to(tmp_path / "nowhere")
    with refuses(UsageError):
        imported(small_bust(), tmp_path)
    assert left_in(tmp_path) == {"body.urdf", "new"} or not target.exists()
    if kind == "folder":
        assert (target / "robot.yaml").read_text() == "mine" and left_in(target) == {"robot.yaml"}


def test_a_failure_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise InputError("no")

    monkeypatch.setattr("retarget.setup.import_robot.fit", fails)
    with pytest.raises(InputError):
        imported(small_bust(), tmp_path)
    assert left_in(tmp_path) == {"body.urdf"}


@pytest.mark.parametrize("name", ["a b/c", *(pytest.param(name, marks=pytest.mark.long) for name in ("..", "  "))])
def test_names_are_made_fit(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "body.urdf"
    path.write_text(small_bust())
    done = import_robot(path, name=name, samples=10)
    assert done.folder.parent == Path() and done.folder.is_dir() and "/" not in done.draft.name


@pytest.mark.long
@pytest.mark.parametrize("robot", [*SHIPPED, "stranger", *(f"unnamed {name}" for name in SHIPPED)])
def test_no_hand_work_before_the_demo(robot: str, tmp_path: Path) -> None:
    """Asked were fewer than 15 lines to change before a mock run; none has to be."""
    name = robot.removeprefix("unnamed ")
    if robot == "stranger":
        text, suffix = humanoid(), "urdf"
    else:
        text = shipped_body(name).read_text() if robot == name else scrambled(name)
        suffix = "xml"
    done = imported(text, tmp_path, samples=2000, suffix=suffix)
    assert not done.problems and not done.draft.missing
    assert (check_stand(load_robot(done.folder)) or 0.0) > 0.02
    with pytest.raises(SystemExit) as leaving:
        main(["demo", str(tmp_path / "demo"), "--robot", str(done.folder), "--bus", "mock"])
    assert not leaving.value.code
    report = json.loads((tmp_path / "demo" / "report.json").read_text())
    assert report["stop"]["reason"] is None
    assert report["limit_violations"] == {"position": 0, "velocity": 0, "acceleration": 0}
    assert report["hand_path_ratio"] > 0.9
