"""How a live run begins: what makes no sense is refused before a port is opened; the help names every performer."""

import re
from pathlib import Path
from typing import get_type_hints

import pytest

from retarget.catalogue import Kind, entries
from retarget.cli.run import run
from retarget.errors import UsageError
from retarget.live.live_options import LiveOptions
from support.messages import refuses


@pytest.mark.parametrize("countdown", [-5.0, -1e-9, 600.1, float("inf"), float("nan"), float("-inf")])
def test_a_countdown_that_is_none_is_refused(countdown: float) -> None:
    with refuses(UsageError, "--countdown", allowed=(0, 600)):
        LiveOptions(countdown=countdown)


@pytest.mark.parametrize("countdown", [0.0, 3.0, 600.0])
def test_any_other_is_taken(countdown: float) -> None:
    assert LiveOptions(countdown=countdown).countdown == countdown


def test_the_help_names_every_performer_that_is_shipped(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    help_text = get_type_hints(run, include_extras=True)["performer"].__metadata__[0].help
    shipped = {entry.name for entry in entries(Kind.PERFORMER)}
    assert len(shipped) >= 9 and shipped <= set(re.findall(r"\w+", help_text))
