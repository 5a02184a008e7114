"""The command: what it takes, what it prints, how it leaves."""

import json
import os
from pathlib import Path

import pytest

from command_line import Typed, said_by
from messages import shows


def test_a_port_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, shown, _ = said_by(capsys, "doctor", tmp_path / "ttyUSB7", "--json", tmp_path / "found.json")
    shows(shown)
    assert code == 1 and shown.endswith("1 to fix\n")
    (finding,) = json.loads((tmp_path / "found.json").read_text())["findings"]
    assert finding["level"] == "fix" and finding["what"] in shown


def test_a_terminal_at_which_nothing_is_wrong_and_json_that_cannot_be_written(
    tmp_path: Path, done: Typed, capsys: pytest.CaptureFixture[str]
) -> None:
    master, slave = os.openpty()
    terminal = os.ttyname(slave)
    os.close(slave)
    assert done("doctor", terminal).endswith("nothing is wrong\n")
    assert said_by(capsys, "doctor", terminal, "--json", tmp_path / "none/x.json")[0] == 2
    os.close(master)


def test_a_recording(shared: Path, done: Typed) -> None:
    path = shared / "streams/slimevr/full12_vmc_50hz.udprec.gz"
    shows(done("doctor", f"replay://{path}?kind=vmc", "--seconds", "3"))
