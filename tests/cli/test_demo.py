"""`retarget demo`: works on its own, and leaves a report, a recording and pictures."""

import json
import re
from pathlib import Path

import pytest

from messages import mentions, shows
from retarget.cli import main
from retarget.cli.exit import DONE, REFUSED


def demo(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as leaving:
        main(["demo", *map(str, words)])
    return int(leaving.value.code or 0)


def test_the_help_says_which_bus(capsys: pytest.CaptureFixture[str]) -> None:
    assert demo("--help") == DONE
    mentions(capsys.readouterr().out, "--bus", "emulator")


def test_the_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    assert demo() == DONE
    folder = tmp_path / "out" / "demo"
    names = {path.name for path in folder.iterdir()}
    assert names == {"report.json", "report.html", "run.npz", "tracking.png", "angles.png", "balance.png", "poses.png"}
    page = (folder / "report.html").read_text(encoding="utf-8")
    headings = {"Limits", "Motion", "Poses", "Tracking", "Asked and reached", "Balance", "Joint angles"}
    assert headings <= set(re.findall(r"<h2>(.*?)</h2>", page)) and "✗" not in page
    report = json.loads((folder / "report.json").read_text())
    assert report["frames"] == 2232 and report["stop"]["reason"] is None
    assert report["limit_violations"] == {"position": 0, "velocity": 0, "acceleration": 0}
    assert report["hand_path_ratio"] > 0.5
    assert "out/demo/report.json" in capsys.readouterr().out


def test_a_folder_that_is_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    assert demo(tmp_path / "file") == REFUSED
    shows(capsys.readouterr().err)


def test_an_unknown_robot_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert demo(tmp_path / "new", "--robot", "op4") == REFUSED
    assert "op3" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_demo_moves_no_real_servos(capsys: pytest.CaptureFixture[str]) -> None:
    assert demo("--bus", "profile") == REFUSED
    shows(capsys.readouterr().err)
