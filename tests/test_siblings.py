"""`import retarget` notices a foreign `hardware` or `sim` and stays light."""

import subprocess
import sys
from pathlib import Path

import pytest

import retarget
from messages import refuses, shows

HEAVY = ("mujoco", "scipy", "pydantic", "matplotlib", "numpy", "typer", "rich")


def run_python(code: str, *, cwd: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True, timeout=60, check=False
    )


@pytest.mark.parametrize("name", ["hardware", "sim"])
@pytest.mark.parametrize("file", ["{}.py", "{}/__init__.py"])
def test_a_shadow_is_named(name: str, file: str, tmp_path: Path, root: Path) -> None:
    shadow = tmp_path / file.format(name)
    shadow.parent.mkdir(exist_ok=True)
    shadow.write_text("")
    result = run_python(f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(root)!r}]; import retarget", cwd=tmp_path)
    assert result.returncode != 0
    assert str(shadow) in result.stderr
    assert repr(name) in result.stderr
    shows(result.stderr.replace("\n", " "))


def test_a_missing_sibling_is_named(root: Path) -> None:
    code = (
        "import sys; sys.path.insert(0, '')\n"
        "from importlib.machinery import PathFinder\n"
        "class NoSim:\n"
        "    find_spec = lambda name, path=None, target=None: None if name == 'sim' else real(name, path, target)\n"
        "real = PathFinder.find_spec\n"
        "sys.meta_path[:] = [NoSim]\n"
        "import retarget"
    )
    result = run_python(code, cwd=root)
    shows(result.stderr)


def test_import_is_light(root: Path) -> None:
    code = f"import sys, retarget; print(*(name for name in {HEAVY} if name in sys.modules))"
    result = run_python(code, cwd=root)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "", f"heavy modules at import: {result.stdout}"


def test_every_public_name_resolves() -> None:
    for name in retarget.__all__:
        assert getattr(retarget, name) is not None
        assert name in dir(retarget)


def test_an_unknown_name_lists_the_public_ones() -> None:
    with refuses(AttributeError, "SensorFrames"):
        _ = retarget.Retargeter
