"""Fixtures for every test: where recorded data lies, and reproducible hypothesis runs."""

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

pytest_plugins = ["messages", "rotation"]

ROOT = Path(__file__).resolve().parent.parent

# Same examples on every machine and in every run; no deadline, because a shared machine may stall.
settings.register_profile("repeatable", derandomize=True, deadline=None, print_blob=True, max_examples=50)
settings.load_profile("repeatable")


def pytest_collection_finish() -> None:
    """All tests stay until the end: the collector of garbage need not look at them again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def isolated_settings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A developer's own robots and calibrations change no test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        yield


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
