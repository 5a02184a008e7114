"""Of a live run the terminal tells what it does, not a share of something that has no end."""

import io
import sys

import pytest

from retarget.cli.live_controls import LiveStatus
from retarget.cli.live_state import live_state, words_for


def test_words() -> None:
    assert words_for(LiveStatus("moving", True, False, None), approaching=False) == "following"
    assert words_for(LiveStatus("holding", False, False, None), approaching=False) == "holding"
    assert words_for(LiveStatus("moving", True, False, None), approaching=True) == "on its way to the performer"
    assert words_for(LiveStatus("holding", False, True, None), approaching=True) == "paused: holding"
    assert words_for(LiveStatus("stopping", True, True, "SIGTERM"), approaching=False) == "stopping"
    assert words_for(LiveStatus(None, True, False, None), approaching=False) == "following"


class Terminal(io.StringIO):
    """One that a person looks at."""

    def isatty(self) -> bool:
        """Yes."""
        return True


@pytest.mark.parametrize("screen", [Terminal(), io.StringIO()])
def test_a_terminal_tells_it_and_a_pipe_hears_nothing(screen: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with live_state("op3", lambda: "holding"):
        pass
    told = screen.getvalue()
    assert ("op3" in told and "holding" in told and "0:00:00" in told) if screen.isatty() else not told
    assert "%" not in told
