"""The command line in this process: its exit code, and what it says."""

import pytest

from retarget.cli import main


def code_of(*words: object) -> int:
    """The exit code of `retarget WORDS`."""
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    assert isinstance(left.value.code, int | None)
    return left.value.code or 0


def said_by(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `retarget WORDS`."""
    capsys.readouterr()
    code = code_of(*words)
    out, err = capsys.readouterr()
    return code, out, err
