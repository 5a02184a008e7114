"""Every protection of guard, gate, supervisor and loop has a test that fails without it."""

import subprocess
import sys
from pathlib import Path

import pytest

RUN = Path(__file__).with_name("run.py")


def test_the_list_of_mutants_fits_the_files() -> None:
    done = subprocess.run([sys.executable, str(RUN), "--check"], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[0]) >= 30


@pytest.mark.long
def test_every_mutant_is_caught() -> None:
    done = subprocess.run([sys.executable, str(RUN)], capture_output=True, text=True, timeout=7200)
    assert done.returncode == 0, done.stdout + done.stderr
