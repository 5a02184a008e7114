"""`retarget demo`: works on its own, and leaves a report, a recording and pictures."""

import json
import re
from functools import partial
from pathlib import Path

import pytest

from command_line import code_of
from retarget.cli.exit import DONE
from sim.performer import synthetic_performer

demo = partial(code_of, "demo")


def test_the_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    whole = synthetic_performer()
    monkeypatch.setattr("sim.performer.synthetic_performer", lambda: whole.cut(0.0, 4.0))
    monkeypatch.chdir(tmp_path)
    assert demo() == DONE
    folder = tmp_path / "out" / "demo"
    names = {path.name for path in folder.iterdir()}
    assert names == {"report.json", "report.html", "run.npz", "tracking.png", "angles.png", "balance.png", "poses.png"}
    page = (folder / "report.html").read_text(encoding="utf-8")
    headings = {"Limits", "Motion", "Poses", "Tracking", "Asked and reached", "Balance", "Joint angles"}
    assert headings <= set(re.findall(r"<h2>(.*?)</h2>", page)) and "✗" not in page
    report = json.loads((folder / "report.json").read_text())
    assert report["frames"] == 481 and report["stop"]["reason"] is None
    assert report["limit_violations"] == {"position": 0, "velocity": 0, "acceleration": 0}
    assert report["hand_path_ratio"] > 0.5
    assert "out/demo/report.json" in capsys.readouterr().out
