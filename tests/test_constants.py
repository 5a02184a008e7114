"""Every numeric constant of a module says its unit, and its source or a reason, in a docstring below or a comment."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PYTHON = [path for top in ("retarget", "hardware", "sim") for path in sorted((ROOT / top).rglob("*.py"))]
RUST = sorted(path for path in (ROOT / "retarget/solver/src").rglob("*.rs") if "tests" not in path.parts)
NAME = re.compile(r"_?[A-Z][A-Z0-9_]*$")
REMARK = re.compile(r"#(?! (?:fmt|noqa|type|pragma):)")
CONST = re.compile(r"^\s*(?:pub(?:\([a-z]+\))? )?(?:const|static) [A-Z_0-9]+: [^=]+= .*\d")


def unexplained(source: str) -> Iterator[str]:
    """Names of numeric constants of a module without a remark on their lines or above, or a docstring below.

    Constants in a block without blank lines share the docstring that ends it, or the remark that begins it.
    """
    lines = source.split("\n")
    body = ast.parse(source).body
    explained = False
    for number in range(len(body) - 1, -1, -1):
        node = body[number]
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            explained = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            explained &= number > 0 and node.lineno == (body[number - 1].end_lineno or 0) + 1
            continue
        own = range(node.lineno - 1, node.end_lineno or node.lineno)
        above = node.lineno - 2
        while above >= 0 and lines[above] and not lines[above].startswith((" ", "#", '"', ")", "}", "]", "@")):
            above -= 1
        said = explained or any(REMARK.search(lines[row]) for row in own) or lines[above].startswith("#")
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
        if not said and numeric(node.value):
            yield from (name for name in names if NAME.match(name))
        before = body[number - 1] if number else None
        explained &= before is not None and node.lineno == (before.end_lineno or 0) + 1


def numeric(value: ast.expr) -> bool:
    """Whether an expression holds a number that is more than an index or a repetition of text."""
    if isinstance(value, ast.Lambda):
        return False
    return any(isinstance(part, ast.Constant) and type(part.value) in (int, float, complex) for part in ast.walk(value))


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("A = 1", ["A"]),
        ("A = 1  # s: twice the period", []),
        ("# s: twice the period\nA = 1", []),
        ('A = 1\n"""[s] Twice the period."""', []),
        ('A = 1\nB = 2\n"""[s] Both of the period."""', []),
        ('A = 1\n\nB = 2\n"""[s] Twice the period."""', ["A"]),
        ("A = 1  # noqa: X", ["A"]),
        ("A = B = np.array([1.0])", ["A", "B"]),
        ("A, B = 1, 2", ["A", "B"]),
        ("a = 1", []),
        ("A = 'text'", []),
    ],
)
def test_what_is_unexplained(source: str, found: list[str]) -> None:
    assert list(unexplained(source)) == found


def test_every_constant_of_python_is_explained() -> None:
    found = {path.relative_to(ROOT).as_posix(): list(unexplained(path.read_text(encoding="utf-8"))) for path in PYTHON}
    assert not {place: names for place, names in found.items() if names}


def test_every_constant_of_rust_is_explained() -> None:
    """By a comment on its line or the line above."""
    for path in RUST:
        lines = path.read_text(encoding="utf-8").split("#[cfg(test)]")[0].split("\n")
        for number, line in enumerate(lines):
            if CONST.match(line):
                above = lines[number - 1].strip()
                assert "//" in line or above.startswith(("//", "#[")), f"{path.name}:{number + 1}: {line.strip()}"
