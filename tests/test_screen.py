"""stdout that is gone or full costs neither a file nor a traceback."""

import errno
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from retarget.cli.screen import Screen, careful_stdout

NO_SPACE = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
GONE = BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))


class Broken(io.StringIO):
    def __init__(self, error: OSError) -> None:
        super().__init__()
        self.error = error

    def write(self, text: str) -> int:
        raise self.error


@pytest.mark.parametrize(("error", "reason"), [(NO_SPACE, os.strerror(errno.ENOSPC)), (GONE, "")])
def test_a_failure_is_remembered_and_not_raised(error: OSError, reason: str) -> None:
    screen = Screen(Broken(error))
    assert screen.write("text") == 4
    assert screen.failure is error and screen.reason == reason


def test_what_works_passes(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout
    with careful_stdout() as screen:
        sys.stdout.write("text\n")
    assert sys.stdout is before
    assert screen is not None and screen.reason == ""
    assert capsys.readouterr().out == "text\n"


def test_a_process_without_stdout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    with careful_stdout() as screen:
        assert screen is None


@pytest.mark.parametrize("words", [["robots"], ["--help"], ["check", "op3"]])
def test_any_command_on_a_full_device_is_one_line(words: list[str]) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(
            [sys.executable, "-m", "retarget", *words], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert result.returncode == 2
    assert result.stderr.startswith("error: stdout: cannot print") and len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize("words", [["robots"], ["--help"], ["check", "op3"]])
def test_any_command_whose_reader_has_left_is_quiet(words: list[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as pipe:
        result = subprocess.run(
            [sys.executable, "-m", "retarget", *words], stdout=pipe, stderr=subprocess.PIPE, text=True
        )
    assert (result.returncode, result.stderr) == (0, "")
