"""`make mutants`: removes one protection at a time, and looks whether a test fails.

`mutants.yaml` lists the mutants: a name, a file, a text that occurs in it once (`find`), what stands there instead
(`replace`), and the narrowest tests that must fail. Exit code 0: all tests pass without a mutant, and every mutant is
caught; 1: a mutant survives, or a test fails without one; 2: the list does not fit the files.

`--random K --seed N`: K further mutants of the same files, drawn by a few operators. Their tests are all that the list
names for their file. Some change nothing that can be observed, so survivors are printed and do not count.
"""

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
LIST = ROOT / "tests" / "mutants.yaml"
LEFT_OUT = (".*", "out", "target", "wheels", "__pycache__", "node_modules")
"""Folders that are not copied."""
TIME_LIMIT_S = 300.0
"""For the tests of one mutant. Tests that take longer have not failed: the mutant survives."""
PASSED, FAILED = 0, 1
"""Exit codes of pytest; all others are errors of a mutant or of its list of tests."""
OTHER_COMPARISON: dict[type[ast.cmpop], ast.cmpop] = {
    ast.Lt: ast.GtE(),
    ast.GtE: ast.Lt(),
    ast.Gt: ast.LtE(),
    ast.LtE: ast.Gt(),
    ast.Eq: ast.NotEq(),
    ast.NotEq: ast.Eq(),
    ast.Is: ast.IsNot(),
    ast.IsNot: ast.Is(),
    ast.In: ast.NotIn(),
    ast.NotIn: ast.In(),
}


@dataclass(frozen=True)
class Mutant:
    """One change of one file: all of its text before and after, and the pytest targets that must fail."""

    name: str
    file: str
    before: str
    after: str
    tests: tuple[str, ...]


def listed(root: Path = ROOT) -> list[Mutant]:
    """The mutants of the list. Raises ValueError with everything in it that does not fit the files."""
    mutants, problems = list[Mutant](), list[str]()
    for entry in yaml.safe_load(LIST.read_text(encoding="utf-8")):
        text = (root / entry["file"]).read_text(encoding="utf-8")
        found = text.count(entry["find"])
        if found != 1:
            problems.append(f"{entry['name']}: `find` occurs {found} times in {entry['file']}; allowed: once")
        problems += [f"{entry['name']}: no test {test}" for test in entry["tests"] if not _is_test(root, test)]
        after = text.replace(entry["find"], entry["replace"])
        mutants.append(Mutant(entry["name"], entry["file"], text, after, tuple(entry["tests"])))
    names = [mutant.name for mutant in mutants]
    problems += [f"{name}: listed twice" for name in sorted({name for name in names if names.count(name) > 1})]
    if problems:
        raise ValueError("\n".join(problems))
    return mutants


def drawn(mutants: Sequence[Mutant], count: int, seed: int) -> list[Mutant]:
    """So many random mutants of the files of the list."""
    tests: dict[str, set[str]] = {}
    texts = {mutant.file: mutant.before for mutant in mutants}
    for mutant in mutants:
        tests.setdefault(mutant.file, set()).update(test.split("::")[0] for test in mutant.tests)
    possible = [
        Mutant(f"{file}:{line} {what}", file, text, after, tuple(sorted(tests[file])))
        for file, text in texts.items()
        for line, what, after in _changes(text)
    ]
    return random.Random(seed).sample(possible, min(count, len(possible)))


def _is_test(root: Path, test: str) -> bool:
    path, _, name = test.partition("::")
    function = f"def {name.split('[')[0]}(" if name else ""
    return (root / path).is_file() and function in (root / path).read_text(encoding="utf-8")


def _changes(text: str) -> Iterator[tuple[int, str, str]]:
    """Every change that an operator makes of a module's text: its line, in words, and the text with it."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            other = ast.Compare(node.left, [OTHER_COMPARISON[type(node.ops[0])]], node.comparators)
            yield node.lineno, f"`{ast.unparse(other)}`", _put(text, node, node, f"({ast.unparse(other)})")
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            operand = ast.unparse(node.operand)
            yield node.lineno, f"`{operand}` without `not`", _put(text, node, node, f"({operand})")
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)
        ):
            yield node.lineno, f"2 x {node.value}", _put(text, node, node, f"(2 * {node.value})")
        elif isinstance(node, ast.If):
            yield (
                node.lineno,
                f"`if {ast.unparse(node.test)}`: no body",
                _put(text, node.body[0], node.body[-1], "pass"),
            )


def _put(text: str, first: ast.expr | ast.stmt, last: ast.expr | ast.stmt, instead: str) -> str:
    """The text with `instead` in the place of the nodes from `first` to `last`."""
    lines = text.encode().splitlines(keepends=True)  # columns of nodes count bytes
    assert last.end_lineno is not None and last.end_col_offset is not None
    head = b"".join(lines[: first.lineno - 1]) + lines[first.lineno - 1][: first.col_offset]
    tail = lines[last.end_lineno - 1][last.end_col_offset :] + b"".join(lines[last.end_lineno :])
    return (head + instead.encode() + tail).decode()


@contextmanager
def copied() -> Iterator[Path]:
    """A copy of the repository in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = Path(folder) / "copy"
        shutil.copytree(ROOT, copy, symlinks=True, ignore=shutil.ignore_patterns(*LEFT_OUT))
        yield copy


@contextmanager
def applied(mutant: Mutant, copy: Path) -> Iterator[None]:
    """The copy with a mutant. Another time of change keeps Python from using bytecode that it has of the file."""
    path = copy / mutant.file
    times = path.stat()
    path.write_text(mutant.after, encoding="utf-8")
    os.utime(path, (times.st_atime, times.st_mtime + 10.0))
    try:
        yield
    finally:
        path.write_text(mutant.before, encoding="utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def run_tests(
    copy: Path, tests: Sequence[str], *, keeps_bytecode: bool = False, seconds: float
) -> tuple[int | None, str]:
    """The exit code of pytest in the copy, None after the time limit, and its last lines."""
    places = {
        "PYTHONPATH": str(copy),
        "RETARGET_SHARED": os.environ.get("RETARGET_SHARED", str(ROOT.parent / "shared")),
    }
    bytecode = {} if keeps_bytecode else {"PYTHONDONTWRITEBYTECODE": "1"}
    options = ["-x", "-q", "-n", "0", "--no-header", "--tb=short", "-p", "no:cacheprovider", "--timeout", "0"]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *options, *tests],
            cwd=copy,
            env={**os.environ, **places, **bytecode},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=seconds,
        )
    except subprocess.TimeoutExpired:
        return None, ""
    return done.returncode, "\n".join((done.stdout + done.stderr).splitlines()[-30:])


def survivors(copy: Path, mutants: Sequence[Mutant]) -> list[str]:
    """Try each mutant, print a line about it, and return the names of those that no test has caught."""
    found = []
    for mutant in mutants:
        begun = time.monotonic()
        with applied(mutant, copy):
            code, output = run_tests(copy, mutant.tests, seconds=TIME_LIMIT_S)
        verdict = {PASSED: "SURVIVES", FAILED: "caught", None: "TIME LIMIT"}.get(code, "ERROR")
        print(f"{verdict:10} {time.monotonic() - begun:6.1f} s  {mutant.file}  {mutant.name}", flush=True)
        if verdict == "ERROR":
            print(output, flush=True)
        if verdict != "caught":
            found.append(mutant.name)
    return found


def main() -> int:
    """The command. Returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only whether the list fits the files")
    parser.add_argument("--only", default="", metavar="TEXT", help="only mutants with this in their name or file")
    parser.add_argument("--random", type=int, default=0, metavar="K", help="so many random mutants instead of the list")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of random mutants")
    options = parser.parse_args()
    try:
        mutants = listed()
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    if options.check:
        print(f"{len(mutants)} mutants")
        return 0
    chosen = [mutant for mutant in mutants if options.only in mutant.name or options.only in mutant.file]
    if not chosen:
        print(f"no mutant has {options.only!r} in its name or file", file=sys.stderr)
        return 2
    if options.random:
        print(f"seed {options.seed}")
        chosen = drawn(chosen, options.random, options.seed)
    with copied() as copy:
        tests = sorted({test for mutant in chosen for test in mutant.tests})
        code, output = run_tests(copy, tests, keeps_bytecode=True, seconds=4.0 * TIME_LIMIT_S)
        if code != PASSED:
            print(f"without a mutant, these tests do not pass:\n{output}", file=sys.stderr)
            return 1
        left = survivors(copy, chosen)
    print(f"{len(chosen)} mutants, {len(left)} of them not caught", *left, sep="\n   ")
    return 1 if left and not options.random else 0


if __name__ == "__main__":
    sys.exit(main())
