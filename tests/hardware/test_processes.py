"""Other processes, named as a person knows them."""

from pathlib import Path

import pytest

from hardware.processes import named_process


@pytest.mark.parametrize(
    ("cmdline", "said"),
    [
        (b"retarget\0servo\0monitor\0", "retarget servo monitor"),
        (b"/opt/v/bin/python3.12\0/opt/v/bin/retarget\0emulate\0--link\0a/b\0", "retarget emulate --link a/b"),
        (b"/opt/bin/python\0-m\0retarget\0run\0", "python -m retarget run"),
        (b"/usr/bin/screen\0/dev/ttyUSB0\0", "screen /dev/ttyUSB0"),
        (b"python3\0", "python3"),
        (b"", "short"),
        (b"a\x1b[2J\xff\0\nb\0", "a\\x1b[2J\N{REPLACEMENT CHARACTER} \\nb"),
    ],
)
def test_a_process_is_named_by_what_was_typed(tmp_path: Path, cmdline: bytes, said: str) -> None:
    (tmp_path / "12").mkdir()
    (tmp_path / "12" / "cmdline").write_bytes(cmdline)
    (tmp_path / "12" / "comm").write_bytes(b"short\n")
    assert named_process(12, tmp_path) == f"process 12 ({said})"
