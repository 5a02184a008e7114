"""`retarget judge`: the table, the verdict, and the JSON."""

import json
from pathlib import Path

import pytest

from command_line import said_by
from messages import shows
from recordings import moved, op3, saved
from retarget.model.robot import load_robot


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return saved(moved(op3(), rows=60), tmp_path / "run.npz", load_robot("op3").profile.body_path)


def test_the_table_and_the_json(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out_file = tmp_path / "judged.json"
    code, out, err = said_by(capsys, "judge", run, "--robot", "op3", "--json", out_file)
    assert code == 0 and err == ""
    shows(out.replace(str(tmp_path), ""), "60 rows", "LOST")
    said = json.loads(out_file.read_text())
    lost = [line["name"] for line in said["lines"] if line["kept"] is False]
    assert len(lost) > 2 and all(name in said["verdict"] and name in out for name in lost)
    assert said["limits"]["velocity"]["share"] > 0.0 and said["report"] is None and said["rows"] == 60


def test_an_order_that_is_none(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = said_by(capsys, "judge", run, "--robot", "op3", "--quaternion", "zyx")
    assert code == 2
    shows(err, "--quaternion", "zyx", "xyzw")
