"""Every protection of guard, gate, supervisor and loop has a test that fails without it."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import yaml

from mutants import FAILED, LIST, PASSED, TIME_LIMIT_S, Mutant, applied, copied, listed, run_tests

NAMES = [entry["name"] for entry in yaml.safe_load(LIST.read_text(encoding="utf-8"))]


def test_the_list_of_mutants_fits_the_files() -> None:
    assert len(listed()) >= 30


@pytest.fixture(scope="module")
def copy() -> Iterator[Path]:
    with copied() as folder:
        yield folder


@cache
def passes(copy: Path, tests: tuple[str, ...]) -> tuple[bool, str]:
    """True if tests pass without a mutant; and their output."""
    code, output = run_tests(copy, tests, keeps_bytecode=True, seconds=TIME_LIMIT_S)
    return code == PASSED, output


@cache
def mutants() -> dict[str, Mutant]:
    return {one.name: one for one in listed()}


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_a_mutant_is_caught(name: str, copy: Path) -> None:
    mutant = mutants()[name]
    passed, output = passes(copy, mutant.tests)
    assert passed, f"without the mutant:\n{output}"
    with applied(mutant, copy):
        code, output = run_tests(copy, mutant.tests, seconds=TIME_LIMIT_S)
    assert code == FAILED, f"with it:\n{output}"
