"""The command: what it takes, what it prints, how it leaves."""

import json
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from command_line import code_of
from messages import shows

leave = partial(code_of, "doctor")


def test_a_port_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert leave(str(tmp_path / "ttyUSB7"), "--json", str(tmp_path / "found.json")) == 1
    shown = capsys.readouterr().out
    shows(shown)
    assert shown.endswith("1 to fix\n")
    (finding,) = json.loads((tmp_path / "found.json").read_text())["findings"]
    assert finding["level"] == "fix" and finding["what"] in shown


@pytest.fixture
def terminal() -> Iterator[str]:
    """A pseudo-terminal that no other process has open."""
    master, slave = os.openpty()
    path = os.ttyname(slave)
    os.close(slave)
    yield path
    os.close(master)


def test_nothing_wrong_is_0(terminal: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert leave(terminal) == 0
    assert capsys.readouterr().out.endswith("nothing is wrong\n")


def test_json_that_cannot_be_written(terminal: str, tmp_path: Path) -> None:
    assert leave(terminal, "--json", str(tmp_path / "none/x.json")) == 2


def test_a_recording(shared: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = shared / "streams/slimevr/full12_vmc_50hz.udprec.gz"
    assert leave(f"replay://{path}?kind=vmc", "--seconds", "3") == 0
    shows(capsys.readouterr().out)
