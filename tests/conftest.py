"""Fixtures for every test: where recorded data lies, and reproducible hypothesis runs."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).resolve().parent.parent

# Same examples on every machine and in every run; no deadline, because a shared machine may stall.
settings.register_profile("repeatable", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of recorded motion and reference facts: `../shared`, or where RETARGET_SHARED says; absent, the test is
    skipped."""
    path = Path(os.environ.get("RETARGET_SHARED", str(ROOT.parent / "shared")))
    if not (path / "mocap").is_dir():
        pytest.skip(f"no recorded motion at {path} (put it beside the repository, or set RETARGET_SHARED)")
    return path


@pytest.fixture(scope="session")
def root() -> Path:
    """Root of the repository."""
    return ROOT
