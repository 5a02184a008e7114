"""Python, wheel, and what a frame costs."""

import importlib

import pytest

from doctor_rig import mends, text_of
from retarget.doctor.finding import Level
from retarget.doctor.solver_findings import frame_findings, python_findings, seconds_per_frame
from support.messages import shows


def test_this_python_will_do() -> None:
    assert not mends(python_findings())
    assert "3.10.4" in mends(python_findings((3, 10, 4)))[0]


def test_a_wheel_that_cannot_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> None:
        raise ImportError("wrong machine")

    monkeypatch.setattr(importlib, "import_module", refuse)
    shows(text_of(python_findings()))


@pytest.mark.parametrize(("cost", "level"), [(0.0005, Level.OK), (0.005, Level.NOTE), (0.02, Level.MEND)])
def test_the_cost_of_a_frame(cost: float, level: Level) -> None:
    assert [finding.level for finding in frame_findings(lambda: cost)] == [level]


def test_a_frame_is_really_solved() -> None:
    assert 1e-5 < seconds_per_frame(5) < 0.5
