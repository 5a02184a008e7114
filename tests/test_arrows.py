"""Imports run one way: retarget -> hardware; sim -> retarget, hardware; only the command line and tests use sim."""

import ast
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
