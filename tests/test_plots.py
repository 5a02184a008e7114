"""Pictures are made, are PNG files of a sensible size, and are left out where there is nothing to show."""

from pathlib import Path

import numpy as np
import pytest

from retarget.errors import UsageError
from retarget.pipeline import Pipeline
from retarget.plots import PICTURES, write_plots
from retarget.plots.balance import plot_balance
from retarget.plots.poses import telling_ticks
from retarget.run_result import RunResult
from rig import Rig, StubReconstructor, person, result, short_clip


@pytest.fixture(scope="module")
def run() -> RunResult:
    rig, human, clip = Rig(np.zeros((51, 20))), person(), short_clip()
    ending = Pipeline(clip=clip, reconstructor=StubReconstructor(human), robot=rig.side).run()
    return result(ending, clip, human, rig.robot)


@pytest.fixture(scope="module")
def human_run() -> RunResult:
    human, clip = person(), short_clip(rate_hz=None)
    ending = Pipeline(clip=clip, reconstructor=StubReconstructor(human)).run()
    return result(ending, clip, human, None)


def test_all_pictures_of_a_robot(run: RunResult, tmp_path: Path) -> None:
    written = write_plots(run, tmp_path / "new" / "folder")
    assert [path.stem for path in written] == list(PICTURES)
    for path in written:
        content = path.read_bytes()
        assert content.startswith(b"\x89PNG") and 10_000 < len(content) < 1_000_000


def test_a_human_has_no_balance(human_run: RunResult, tmp_path: Path) -> None:
    assert plot_balance(human_run) is None
    assert PICTURES["poses"](human_run) is not None and PICTURES["tracking"](human_run) is not None


def test_poses_are_spread_over_the_run(run: RunResult) -> None:
    ticks = [row - run.record.following.start for row in telling_ticks(run)]
    assert len(ticks) == 9 and ticks == sorted(ticks)
    parts = np.linspace(0, 51, 10).astype(int)
    assert [int(np.searchsorted(parts, tick, side="right")) for tick in ticks] == list(range(1, 10))


def test_a_run_of_one_tick_has_no_pictures(human_run: RunResult, tmp_path: Path) -> None:
    from dataclasses import replace

    assert write_plots(replace(human_run, record=human_run.record.first(1)), tmp_path) == []


def test_a_folder_that_cannot_be_made(run: RunResult, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="--plots"):
        write_plots(run, tmp_path / "file")
