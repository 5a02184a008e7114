"""`retarget judge`: the table, the verdict, and the JSON."""

import json
from pathlib import Path

from command_line import Typed
from messages import shows
from recordings import moved, op3, saved
from retarget.model.robot import load_robot


def test_the_table_the_json_and_an_order_that_is_none(tmp_path: Path, done: Typed, refused: Typed) -> None:
    run = saved(moved(op3(), rows=60), tmp_path / "run.npz", load_robot("op3").profile.body_path)
    out = done("judge", run, "--robot", "op3", "--json", tmp_path / "judged.json")
    shows(out.replace(str(tmp_path), ""), "60 rows", "LOST")
    said = json.loads((tmp_path / "judged.json").read_text())
    lost = [line["name"] for line in said["lines"] if line["kept"] is False]
    assert len(lost) > 2 and all(name in said["verdict"] and name in out for name in lost)
    assert said["limits"]["velocity"]["share"] > 0.0 and said["report"] is None and said["rows"] == 60
    shows(refused("judge", run, "--robot", "op3", "--quaternion", "zyx"), "--quaternion", "zyx", "xyzw")
    shows(refused("judge", run, "--robot", "op3", "--fps", "30"), "--fps", "run")
