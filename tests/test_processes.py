"""Processes in a person's words."""

import os
from pathlib import Path

import pytest

from hardware.processes import LONGEST, PROCESSES, named_process


def _process(folder: Path, cmdline: bytes, comm: bytes = b"short\n") -> str:
    (folder / "12").mkdir()
    (folder / "12" / "cmdline").write_bytes(cmdline)
    (folder / "12" / "comm").write_bytes(comm)
    return named_process(12, folder)


@pytest.mark.parametrize(
    ("cmdline", "said"),
    [
        (b"retarget\0servo\0monitor\0", "process 12 (retarget servo monitor)"),
        (
            b"/opt/v/bin/python3.12\0/opt/v/bin/retarget\0emulate\0--link\0a/b\0",
            "process 12 (retarget emulate --link a/b)",
        ),
        (b"/opt/bin/python\0-m\0retarget\0run\0", "process 12 (python -m retarget run)"),
        (b"/usr/bin/screen\0/dev/ttyUSB0\0", "process 12 (screen /dev/ttyUSB0)"),
        (b"python3\0", "process 12 (python3)"),
        (b"", "process 12 (short)"),
        (b"a\x1b[2J\xff\0\nb\0", "process 12 (a?[2J\N{REPLACEMENT CHARACTER} ?b)"),
    ],
)
def test_a_process_is_named_by_what_was_typed(tmp_path: Path, cmdline: bytes, said: str) -> None:
    assert _process(tmp_path, cmdline) == said


def test_a_long_command_line_is_shortened(tmp_path: Path) -> None:
    said = _process(tmp_path, b"retarget\0" + b"x" * 5000)
    assert said.endswith("xxx...)") and len(said) == LONGEST + len("process 12 ()")


def test_one_that_is_gone_has_its_number(tmp_path: Path) -> None:
    assert named_process(12, tmp_path) == "process 12"


@pytest.mark.skipif(not PROCESSES.is_dir(), reason="only Linux has /proc")
def test_this_one() -> None:
    assert named_process(os.getpid()).startswith(f"process {os.getpid()} (")
