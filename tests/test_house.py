"""The house rules that a machine can check: arrows between folders, size of files and functions, what is kept."""

import ast
import hashlib
import re
import subprocess
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
OURS = ("hardware", "retarget", "sim")
SOURCES = (*OURS, "tests", "benchmarks", "examples", "docs")
MAX_LINES = 800
MAX_FUNCTION = 80
LARGEST, LARGEST_PICTURE = 1_000_000, 2_000_000
FORBIDDEN_CALLS = {"eval", "exec", "pickle.load", "pickle.loads", "yaml.load", "yaml.unsafe_load", "yaml.full_load"}
FORBIDDEN_NAMES = {call.split(".")[-1] for call in FORBIDDEN_CALLS}
ALLOWED = {
    "hardware": {"hardware"},
    "retarget": {"retarget", "hardware"},
    "sim": {"sim", "retarget", "hardware"},
    "retarget/cli": {"retarget", "hardware", "sim"},
}
"""Imports run one way; only the command line and tests use sim."""
ARROWS = """
schema <- model <- ik <- human <- robot
                   ik <- safety
          model <- sources <- live
                     human <- live
{robot, safety, live} <- run <- recording <- report <- pictures <- web <- setup <- batch <- cli
                         run <- lerobot
"""
"""A folder of `retarget` may import those to its left, beside itself and what lies flat in `retarget`."""


def below(arrows: str) -> dict[str, set[str]]:
    """The folders to the left of each, near and far."""
    beside: dict[str, set[str]] = {}
    for line in arrows.strip().splitlines():
        steps = [set(re.findall(r"\w+", step)) for step in line.split("<-")]
        for left, right in pairwise(steps):
            for folder in right:
                beside.setdefault(folder, set()).update(left)
    found: dict[str, set[str]] = {}
    for folder in TopologicalSorter(beside).static_order():  # those to the left come first
        found[folder] = set().union(*({left} | found[left] for left in beside.get(folder, set())))
    return found


BELOW = below(ARROWS)


@cache
def sources(*folders: str) -> list[str]:
    """Places of the Python files of folders."""
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py*"))]
    return [path.relative_to(ROOT).as_posix() for path in files if path.suffix in {".py", ".pyi"}]


def nodes(place: str) -> Iterator[ast.AST]:
    """Of a file's syntax tree."""
    return ast.walk(ast.parse((ROOT / place).read_text(encoding="utf-8")))


@cache
def imported(place: str) -> frozenset[str]:
    """Modules, and names in modules, that a file of ours imports: anywhere in it, for types too."""
    names: set[str] = set()
    for node in nodes(place):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{place}: relative import on line {node.lineno}"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def tracked() -> list[str]:
    """Files that git knows; without git (an unpacked source archive) the test is skipped."""
    try:
        result = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, timeout=30)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [name for name in result.stdout.decode().split("\0") if name and (ROOT / name).is_file()]


def test_imports_run_one_way() -> None:
    folders = {"hardware", "retarget", "sim", "benchmarks", "tests"}
    for place in sources(*OURS):
        home = "retarget/cli" if place.startswith("retarget/cli/") else place.split("/")[0]
        against = {name.split(".")[0] for name in imported(place)} & folders - ALLOWED[home]
        assert not against, place


def test_folders_import_only_those_below() -> None:
    for place in sources("retarget"):
        home = place.split("/")[1]
        used = {name.split(".")[1] for name in imported(place) if name.startswith("retarget.")} & set(BELOW)
        assert home not in BELOW or used <= BELOW[home] | {home}, place


def test_lerobot_is_a_matter_of_the_plug_in() -> None:
    """The program never depends on LeRobot, nor on the plug-in that it discovers."""
    for place in sources(*OURS):
        assert not {name.split(".")[0] for name in imported(place)} & {"lerobot", "lerobot_robot_retarget"}, place


def test_only_the_clock_reads_a_clock() -> None:
    for place in sources(*OURS):
        if not place.endswith("/clock.py"):
            assert "time" not in {name.split(".")[0] for name in imported(place)}, f"{place}: ask hardware.clock"


def test_only_the_gate_seals_goals() -> None:
    """`hardware.guard._Seal` is what a `CheckedGoal` cannot be made without."""
    users = {place for place in sources(*OURS) if "_Seal" in (ROOT / place).read_text(encoding="utf-8")}
    assert users == {"hardware/guard.py", "retarget/safety/gate.py"}


def test_hardware_takes_no_callbacks_but_of_what_it_says() -> None:
    """Nothing in `hardware` calls back into `retarget`: the guard's methods take data alone."""
    assert "Callable" not in {node.id for node in nodes("hardware/guard.py") if isinstance(node, ast.Name)}


@pytest.mark.parametrize("folder", [*BELOW])
def test_no_modules_of_a_folder_import_each_other_in_a_circle(folder: str) -> None:
    """For types neither."""
    graph = {}
    for place in sources(f"retarget/{folder}"):
        name = place.partition(".")[0].replace("/", ".")
        graph[name] = {one.rpartition(".")[0] for one in imported(place)} - {name}
    assert list(TopologicalSorter(graph).static_order())


def test_a_file_holds_one_concept() -> None:
    places = [*(ROOT / place for place in sources(*SOURCES)), *(ROOT / "retarget/solver/src").rglob("*.rs")]
    long = {path.name: lines for path in places if (lines := len(path.read_text().splitlines())) >= MAX_LINES}
    assert not long


def test_functions_are_short_and_call_nothing_unsafe() -> None:
    for place in sources(*SOURCES):
        for node in nodes(place):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                # A signature is a table (of a command's options, say); the body is the function.
                length = (node.end_lineno or node.lineno) - node.body[0].lineno + 1
                assert length < MAX_FUNCTION, f"{place}: {node.name} has {length} lines"
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
                name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
                unsafe = name in FORBIDDEN_NAMES and ast.unparse(node.func) in FORBIDDEN_CALLS
                assert not unsafe, f"{place}: line {node.lineno}"


def test_what_a_visitor_looks_for_is_kept_and_nothing_large() -> None:
    files = tracked()
    assert {"README.md", "CHANGELOG.md", "SECURITY.md", "Makefile", ".ci/run", "retarget/solver/Cargo.lock"} <= {*files}
    most = {name: LARGEST_PICTURE if name.endswith(".webp") else LARGEST for name in files}
    assert not [name for name in files if (ROOT / name).stat().st_size > most[name]]


def test_the_licence_is_whole() -> None:
    text = (ROOT / "LICENSE").read_bytes()
    assert hashlib.sha256(text).hexdigest() == "cfc7749b96f63bd31c3c42b5c471bf756814053e847c10f3eb003417bc523d30"


def test_versions_agree() -> None:
    wanted = r'^(?:__version__|version) = "(.+)"$'
    files = ("pyproject.toml", "retarget/solver/Cargo.toml", "retarget/__init__.py")
    versions = {re.search(wanted, (ROOT / name).read_text(), re.MULTILINE)[1] for name in files}  # type: ignore[index]
    assert len(versions) == 1, versions


def test_what_is_shipped_has_the_allocator_of_the_system() -> None:
    """The counting one is a feature of the crate that neither maturin nor a default asks for."""
    maturin = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["maturin"]
    features = tomllib.loads((ROOT / "retarget/solver/Cargo.toml").read_text())["features"]
    built = {*maturin["features"], *features.get("default", [])}
    assert "count-allocations" in features and built == {"python"}


def test_no_machine_path_is_written_down() -> None:
    wanted = re.compile(rb"/(?:home|Users|root|work)/\w")
    texts = {".py", ".pyi", ".rs", ".toml", ".yaml", ".md", ".xml", ""}
    for name in tracked():
        path = ROOT / name
        assert path.suffix not in texts or path == Path(__file__) or not wanted.search(path.read_bytes()), name


def test_the_configs_travel_with_the_package() -> None:
    link = ROOT / "retarget/configs"
    assert link.is_symlink() and link.resolve() == ROOT / "configs"


def test_no_recording_is_copied_in(shared: Path) -> None:
    """Recorded motion stays where it is: nothing tracked here equals a file there (small ones aside)."""
    twins: dict[int, list[Path]] = {}
    for path in shared.rglob("*"):
        if path.is_file() and path.stat().st_size > 200:
            twins.setdefault(path.stat().st_size, []).append(path)
    for name in tracked():
        for twin in twins.get((ROOT / name).stat().st_size, []):
            assert twin.read_bytes() != (ROOT / name).read_bytes(), f"{name} is {twin.name}"


def test_links_of_pages_lead_somewhere() -> None:
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        links = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
        missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
        assert not missing, page.name
