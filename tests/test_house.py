"""The house rules that a machine can check."""

import ast
import hashlib
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ("retarget", "hardware", "sim", "tests", "benchmarks", "examples", "docs")
MAX_LINES = 800
MAX_FUNCTION = 50
LARGEST = 600_000
FORBIDDEN_CALLS = {"eval", "exec", "pickle.load", "pickle.loads", "yaml.load", "yaml.unsafe_load", "yaml.full_load"}


def python_files() -> list[Path]:
    return [path for folder in SOURCES for path in sorted((ROOT / folder).rglob("*.py")) if path.is_file()]


def rust_files() -> list[Path]:
    return sorted((ROOT / "retarget/solver/src").rglob("*.rs"))


def test_nothing_large_is_kept() -> None:
    large = [name for name in tracked() if (ROOT / name).is_file() and (ROOT / name).stat().st_size > LARGEST]
    assert not large


def tracked() -> list[str]:
    """Files that git knows; without git (an unpacked source archive) the test is skipped."""
    try:
        result = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, timeout=30)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [name for name in result.stdout.decode().split("\0") if name]


@pytest.mark.parametrize("path", python_files() + rust_files(), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_file_holds_one_concept(path: Path) -> None:
    lines = len(path.read_text(encoding="utf-8").splitlines())
    assert lines < MAX_LINES, f"{lines} lines"


@pytest.mark.parametrize("path", python_files(), ids=lambda path: str(path.relative_to(ROOT)))
def test_functions_are_short_and_call_nothing_unsafe(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            # A signature is a table (of a command's options, say); the body is the function.
            length = (node.end_lineno or node.lineno) - node.body[0].lineno + 1
            assert length < MAX_FUNCTION, f"{node.name} has {length} lines"
        if isinstance(node, ast.Call):
            assert ast.unparse(node.func) not in FORBIDDEN_CALLS, f"line {node.lineno}"


def test_the_crate_is_locked() -> None:
    assert "retarget/solver/Cargo.lock" in tracked()


def test_the_licence_is_whole() -> None:
    text = (ROOT / "LICENSE").read_bytes()
    assert hashlib.sha256(text).hexdigest() == "cfc7749b96f63bd31c3c42b5c471bf756814053e847c10f3eb003417bc523d30"


@pytest.mark.parametrize("name", ["README.md", "CHANGELOG.md", "SECURITY.md", "Makefile", ".ci/run", "configs"])
def test_what_a_visitor_looks_for_is_there(name: str) -> None:
    assert (ROOT / name).exists()


def test_versions_agree() -> None:
    versions = {
        re.search(r'^version = "(.+)"$', (ROOT / name).read_text(), re.MULTILINE)[1]  # type: ignore[index]
        for name in ("pyproject.toml", "retarget/solver/Cargo.toml")
    }
    versions.add(re.search(r'__version__ = "(.+)"', (ROOT / "retarget/__init__.py").read_text())[1])  # type: ignore[index]
    assert len(versions) == 1, versions


def test_what_is_shipped_has_the_allocator_of_the_system() -> None:
    """The counting one is a feature of the crate that neither maturin nor a default asks for."""
    maturin = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["maturin"]
    features = tomllib.loads((ROOT / "retarget/solver/Cargo.toml").read_text())["features"]
    built = {*maturin["features"], *features.get("default", [])}
    assert "count-allocations" in features and built == {"python"}


def test_no_machine_path_is_written_down() -> None:
    wanted = re.compile(rb"/(?:home|Users|root|work)/\w")
    for name in tracked():
        path = ROOT / name
        if (
            path.is_file()
            and path.suffix in {".py", ".pyi", ".rs", ".toml", ".yaml", ".md", ".xml", ""}
            and path != Path(__file__)
        ):
            assert not wanted.search(path.read_bytes()), name


def test_the_configs_travel_with_the_package() -> None:
    link = ROOT / "retarget/configs"
    assert link.is_symlink()
    assert link.resolve() == ROOT / "configs"


def test_no_recording_is_copied_in(shared: Path) -> None:
    """Recorded motion stays where it is: nothing tracked here equals a file there (small ones aside)."""
    twins: dict[int, list[Path]] = {}
    for path in shared.rglob("*"):
        if path.is_file() and path.stat().st_size > 200:
            twins.setdefault(path.stat().st_size, []).append(path)
    for name in tracked():
        path = ROOT / name
        for twin in twins.get(path.stat().st_size, []) if path.is_file() else []:
            assert twin.read_bytes() != path.read_bytes(), f"{name} is {twin.name}"


@pytest.mark.parametrize("page", ["README.md", *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md")))])
def test_links_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in link]
    missing = [link for link in links if not ((ROOT / page).parent / link).exists()]
    assert not missing
