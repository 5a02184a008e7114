"""Command lines as they are typed: one that is done, and one that is refused."""

import pytest

from command_line import Typed, said_by
from retarget.cli.exit import DONE, REFUSED


@pytest.fixture
def done(capsys: pytest.CaptureFixture[str]) -> Typed:
    """Types a command line that ends well; its stdout."""

    def typed(*words: object) -> str:
        code, out, err = said_by(capsys, *words)
        assert code == DONE, err
        return out

    return typed


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Typed:
    """Types a command line that is refused in one message, with nothing on stdout; the message."""

    def typed(*words: object) -> str:
        code, out, err = said_by(capsys, *words)
        assert (code, out) == (REFUSED, "") and err.lower().count("error:") <= 1 and "Traceback" not in err, err
        return err

    return typed
