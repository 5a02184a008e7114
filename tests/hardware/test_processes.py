"""Other processes, named as a person knows them."""

from pathlib import Path

import pytest

from hardware.processes import named_process


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
        (b"a\x1b[2J\xff\0\nb\0", "process 12 (a\\x1b[2J\N{REPLACEMENT CHARACTER} \\nb)"),
    ],
)
def test_a_process_is_named_by_what_was_typed(tmp_path: Path, cmdline: bytes, said: str) -> None:
    assert _process(tmp_path, cmdline) == said
