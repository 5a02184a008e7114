"""Recordings are found by trial, AMC first, anywhere below a folder."""

from pathlib import Path

from benchmarks.paper.trials import CROUCH, find_trial, read_trial
from messages import refuses
from retarget.errors import UsageError


def test_an_amc_comes_before_a_bvh(tmp_path: Path) -> None:
    for name in ("a/02_06.bvh", "b/deep/02_06.amc"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).touch()
    assert find_trial(tmp_path, CROUCH) == tmp_path / "b/deep/02_06.amc"


def test_what_is_not_there_is_none(tmp_path: Path) -> None:
    assert find_trial(tmp_path, CROUCH) is None and read_trial(None, CROUCH) is None


def test_no_folder(tmp_path: Path) -> None:
    with refuses(UsageError, "--mocap"):
        find_trial(tmp_path / "nowhere", CROUCH)
