"""A path that one process has: until it lets go, or ends in whatever way."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from sim.emulator.claim import Claim


def test_one_has_it_at_a_time(tmp_path: Path) -> None:
    first, second = Claim(tmp_path / "servos"), Claim(tmp_path / "servos")
    assert first.take() and first.take()
    assert not second.take()
    assert second.holder() == os.getpid()
    first.release()
    first.release()
    assert second.holder() is None
    assert second.take() and not first.take()
    assert list(tmp_path.iterdir()) == []


def test_the_path_counts_and_not_how_it_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "other").symlink_to("real")
    monkeypatch.chdir(tmp_path)
    first = Claim(Path("real/servos"))
    assert first.take()
    assert not Claim(tmp_path / "other" / ".." / "real" / "servos").take()
    assert not Claim(tmp_path / "other" / "servos").take()
    assert Claim(tmp_path / "real" / "servos2").take()


def test_who_holds_it_can_be_asked_often(tmp_path: Path) -> None:
    first, second = Claim(tmp_path / "servos"), Claim(tmp_path / "servos")
    first.take()
    assert {second.holder() for _ in range(100)} == {os.getpid()}


def test_a_process_that_is_killed_has_nothing_any_more(tmp_path: Path) -> None:
    code = "import sys, signal; from pathlib import Path; from sim.emulator.claim import Claim\n"
    code += "claim = Claim(Path(sys.argv[1])); print(claim.take(), flush=True); signal.pause()"
    path = tmp_path / "servos"
    with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "True\n"
            claim = Claim(path)
            assert not claim.take() and claim.holder() == process.pid
        finally:
            process.send_signal(signal.SIGKILL)
    assert claim.take()
