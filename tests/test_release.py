"""The definition that publishes a release: what it calls is there, and only one job may publish."""

import platform
import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from benchmarks.wheels import PROCESSORS, wheel_line
from retarget.errors import install_step

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")
JOBS: dict[str, Any] = yaml.safe_load(TEXT)["jobs"]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_what_it_runs_is_in_the_repository() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    runs = [step["run"] for job in JOBS.values() for step in job["steps"] if "run" in step]
    targets = [name for run in runs for name in re.findall(r"\bmake ([\w-]+)", run)]
    modules = [name for run in runs for name in re.findall(r"python -m (benchmarks\.\w+)", run)]
    assert targets and all(re.search(rf"^{name}:", makefile, re.MULTILINE) for name in targets)
    assert modules and all((ROOT / name.replace(".", "/")).with_suffix(".py").is_file() for name in modules)


def test_the_line_of_the_readme_installs_the_wheel_of_this_machine(tmp_path: Path) -> None:
    (tmp_path / "wheels").mkdir()
    made = {one: f"wheels/retarget-0.2.0-cp311-abi3-manylinux_2_17_{one}.manylinux2014_{one}.whl" for one in PROCESSORS}
    for name in made.values():
        (tmp_path / name).touch()
    typed = f'pip() {{ echo "$@"; }}; {wheel_line()}'
    done = subprocess.run(["/bin/sh", "-c", typed], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["install", made[platform.machine()]]


def test_its_oldest_python_is_that_of_the_project() -> None:
    oldest = PROJECT["requires-python"].removeprefix(">=")
    assert f'python-version: "{oldest}"' in TEXT and JOBS["smoke"]["strategy"]["matrix"]["python"][0] == oldest


def test_only_the_last_job_may_publish_and_only_what_was_tried() -> None:
    assert yaml.safe_load(TEXT)["permissions"] == {}
    writing = {name: job["permissions"] for name, job in JOBS.items() if "write" in job["permissions"].values()}
    assert writing == {"publish": {"id-token": "write"}}
    assert JOBS["publish"]["environment"] and JOBS["publish"]["needs"] == "smoke" and JOBS["smoke"]["needs"] == "build"
    assert not any("run" in step for step in JOBS["publish"]["steps"]) and "secrets." not in TEXT


def test_every_action_is_pinned_to_a_version() -> None:
    used = re.findall(r"uses: (\S+)", TEXT)
    assert used and all(re.fullmatch(r"[\w.-]+/[\w.-]+@(v\d+\.\d+\.\d+|[0-9a-f]{40})", one) for one in used)


def test_a_missing_package_is_named_in_the_version_that_the_project_takes() -> None:
    pytest.importorskip("mcap", reason="the extra record is not installed")
    lines = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["record"]]
    bounds = next(line for line in lines if line.startswith("mcap"))
    assert install_step("mcap") == f"Install into this environment: pip install '{bounds}'"
    assert install_step("no-such-package").endswith("pip install no-such-package")
