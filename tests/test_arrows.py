"""Imports run one way: retarget -> hardware; sim -> retarget, hardware; only the command line and tests use sim."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ALLOWED = {
    "hardware": {"hardware"},
    "retarget": {"retarget", "hardware"},
    "sim": {"sim", "retarget", "hardware"},
    "retarget/cli": {"retarget", "hardware", "sim"},
}
OURS = {"hardware", "retarget", "sim", "benchmarks", "tests"}
ROOT = Path(__file__).resolve().parent.parent
FILES = sorted(path for folder in ("hardware", "retarget", "sim") for path in (ROOT / folder).rglob("*.py*"))


def imported(path: Path) -> set[str]:
    """Top-level packages of ours that a file imports, anywhere in it, for types too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import on line {node.lineno}"
            names.add(node.module or "")
    return {name.split(".")[0] for name in names} & OURS


@pytest.mark.parametrize(
    "path", [p for p in FILES if p.suffix in {".py", ".pyi"}], ids=lambda p: str(p.relative_to(ROOT))
)
def test_arrows(path: Path) -> None:
    place = path.relative_to(ROOT)
    home = "retarget/cli" if place.parts[:2] == ("retarget", "cli") else place.parts[0]
    assert imported(path) <= ALLOWED[home]


def test_only_the_clock_reads_a_clock() -> None:
    for path in (p for p in FILES if p.suffix == ".py" and p.name != "clock.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert "time" not in names, f"{path.relative_to(ROOT)} imports time; ask hardware.clock"


BELOW: dict[str, set[str]] = {
    "schema": set(),
    "model": {"schema"},
    "ik": {"schema", "model"},
    "human": {"schema", "model", "ik"},
    "robot": {"schema", "model", "ik", "human"},
    "safety": {"schema", "model", "ik"},
    "sources": {"schema", "model"},
    "live": {"schema", "model", "ik", "human", "sources"},
}
"""Folders of `retarget` that a folder may import, beside itself and what lies flat in `retarget`."""
BELOW["run"] = {*BELOW, "run"}
BELOW["recording"] = {*BELOW["run"], "recording"}
BELOW["report"] = BELOW["viewer"] = {*BELOW["recording"], "recording"}
BELOW["setup"] = {*BELOW["recording"], "report", "viewer"}
BELOW["cli"] = {*BELOW["setup"], "setup"}


def folders_imported(path: Path) -> set[str]:
    """Folders of `retarget` that a file imports from."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.split(".")[1] for name in names if name.startswith("retarget.") and name.split(".")[1] in BELOW}


def test_folders_import_only_those_below() -> None:
    found: dict[str, set[str]] = {}
    for path in sorted((ROOT / "retarget").rglob("*.py")):
        place = path.relative_to(ROOT / "retarget")
        home = place.parts[0] if len(place.parts) > 1 else ""
        against = folders_imported(path) - BELOW.get(home, set()) - {home}
        if home in BELOW and against:
            found[place.as_posix()] = against
    assert not found


def test_only_the_gate_seals_goals() -> None:
    """`hardware.guard._Seal` is what a `CheckedGoal` cannot be made without."""
    users = [path for path in FILES if path.suffix == ".py" and "_Seal" in path.read_text(encoding="utf-8")]
    places = {path.relative_to(ROOT).as_posix() for path in users}
    assert places == {"hardware/guard.py", "retarget/safety/gate.py"}


def test_hardware_takes_no_callbacks_but_of_what_it_says() -> None:
    """Nothing in `hardware` calls back into `retarget`: the guard's methods take data alone."""
    tree = ast.parse((ROOT / "hardware" / "guard.py").read_text(encoding="utf-8"))
    assert "Callable" not in {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


@pytest.mark.parametrize("folder", [*BELOW])
def test_no_modules_of_a_folder_import_each_other_in_a_circle(folder: str) -> None:
    """For types neither."""
    graph: dict[str, set[str]] = {}
    for path in sorted((ROOT / "retarget" / folder).rglob("*.py")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        found = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        graph[name] = {node.module or "" for node in found if isinstance(node, ast.ImportFrom)} - {name}
    assert list(TopologicalSorter(graph).static_order())
