"""`retarget check` and `retarget robots` as a user meets them: output, messages, exit codes."""

import re
from pathlib import Path

import pytest

from check_helpers import copy_of_op3
from command_line import said_by as run
from messages import shows, shows_lines
from retarget.schema.catalogue import shipped_folder


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "xdg"))
    return tmp_path / "xdg" / "retarget"


def test_shipped_robot_is_good(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "check", "op3")
    assert (code, err) == (0, "")
    shows(out, "op3")
    assert "20 x XM430-W350" in out


def test_it_says_whether_physics_takes_the_robot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run(capsys, "check", "op3")
    assert re.search(r"physics: +ready\n", out)
    soft = copy_of_op3(tmp_path / "soft", (", gains: {p: 800, i: 0, d: 0}", ""))
    hung = copy_of_op3(tmp_path / "hung", ("root: free", "root: suspended"))
    light = copy_of_op3(tmp_path / "light")
    body = light.with_name("body.xml")
    body.write_text(re.sub(r"<inertial .*?/>", "", body.read_text(encoding="utf-8")), encoding="utf-8")
    for profile, why in ((soft, "1 servo without a P gain"), (hung, "no hook point"), (light, "only guessed")):
        code, out, _ = run(capsys, "check", profile)
        assert code == 0 and re.search(rf"physics: +not possible: .*{why}", out)


def test_every_shipped_file_is_good(capsys: pytest.CaptureFixture[str]) -> None:
    files = sorted(shipped_folder().rglob("*.yaml"))
    code, out, err = run(capsys, "check", *files)
    assert (code, err) == (0, "")
    assert out.count(": good (") == len(files)


def test_one_bad_file_does_not_hide_the_others(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bad = copy_of_op3(tmp_path / "bad", ("{id: 2,", "{id: 1,"), ("root: free", "root: fre"))
    code, out, err = run(capsys, "check", bad, "five")
    assert code == 2
    shows(out, "five")
    shows(err, bad, f"{bad}:5", "'fre'")


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\n",
        "",
        "levels: []\nname: x\n",
        "sensors: {hed: {joint: head}}\n",
        "obstacles: {b: {shape: {bal: {radius: 1}}}}\n",
        "source: sample\nrobto: op3\n",
        "a: [\n",
    ],
)
def test_any_other_file_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(text, encoding="utf-8")
    code, out, err = run(capsys, "check", path)
    assert (code, out) == (2, "")
    shows(err, path)


def test_robots_lists_shipped_and_own(capsys: pytest.CaptureFixture[str], own: Path) -> None:
    copy_of_op3(own / "robots" / "mine")
    copy_of_op3(own / "robots" / "broken", ("root: free", "root: fre"))
    code, out, err = run(capsys, "robots")
    assert (code, err) == (0, "")
    rows = {line.split()[0]: line for line in out.splitlines() if line[:1].strip()}  # what is folded is indented
    assert "shipped" in rows["op3"]
    assert "20 x XM430-W350" in rows["mine"]
    shows(rows["broken"].split("/")[0].rstrip(), "broken")
    shows_lines(out, "--robot")


@pytest.mark.parametrize(("name", "step"), [("body.xml", "robot.yaml"), ("02_06.amc", "retarget inspect")])
def test_what_is_checked_elsewhere(capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str, step: str) -> None:
    (tmp_path / name).touch()
    code, _, err = run(capsys, "check", tmp_path / name)
    assert code == 2
    shows(err)
    assert step in err


def test_a_robot_that_would_fall_over_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shows(run(capsys, "check", "op3")[1], 61)
    soles = copy_of_op3(tmp_path / "op3")
    text = soles.read_text(encoding="utf-8")
    soles.write_text(re.sub(r"(_sole: \{link: \w+, pos: \[)([^,]+),", r"\g<1>0.2,", text), encoding="utf-8")
    code, _, err = run(capsys, "check", soles)
    assert code == 2
    for words in ("would fall over in posture stand", "centre of mass at (", "outside the soles; allowed: inside ("):
        assert words in err
